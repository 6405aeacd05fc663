"""What every room uses: pytrees, checks, rules of numbers, selections, statuses, progress."""
