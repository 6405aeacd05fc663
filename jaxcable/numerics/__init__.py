"""Mathematics without structures: rotations, line search, roots and their derivatives."""
