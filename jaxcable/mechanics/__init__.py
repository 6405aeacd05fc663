"""A structure under load: its system of forces, groups and loads in bundles, phases as ramps."""
