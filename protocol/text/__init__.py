"""What people read: errors, and names and numbers made fit to print."""
