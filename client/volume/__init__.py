"""What is known of a volume before it is drawn: where something is, which way is up."""
