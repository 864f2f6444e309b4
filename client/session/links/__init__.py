"""The connections to the servers of a session: what is heard of them, and what is sent to them."""
