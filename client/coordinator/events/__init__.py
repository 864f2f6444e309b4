"""What the coordinator hears, and what it answers: events and instructions."""
