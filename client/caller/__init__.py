"""The caller of the API and the person at the keyboard: what they hand in, and how they interrupt."""
