"""Everything that starts, records and shows the whole system."""
