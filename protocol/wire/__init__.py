"""How messages travel: sockets, frames of bytes, handshakes and tokens."""
