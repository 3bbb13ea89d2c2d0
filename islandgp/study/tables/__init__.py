"""Tables 9 to 14, and those beyond the paper."""
