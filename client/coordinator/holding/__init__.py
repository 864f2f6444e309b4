"""The volume's way into the map/shade servers, and who of them holds what in which form."""
