"""The peers' own methods, written as plain functions for comparison."""
