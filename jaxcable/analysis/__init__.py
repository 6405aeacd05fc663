"""An analysis from its phases to its solution: checked, scheduled, scanned, told."""
