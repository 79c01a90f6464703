"""What is true: ball, contacts, arm and launcher."""
