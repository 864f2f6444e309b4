"""How times change with the number of servers."""
