"""What a person or a program can do with a run, and what can be read of it: one table, served everywhere."""
