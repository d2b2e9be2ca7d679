"""One module a seed paper: its cases, its published figures, and ours."""
