"""Form finding: shapes, tensions and unstressed lengths that an analysis can begin with."""
