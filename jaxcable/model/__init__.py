"""What a user states of a structure: nodes, groups, supports; and what it is known by."""
