"""What is to be done: from what a user names to assets, and what is made of each."""
