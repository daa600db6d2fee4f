"""Elastic contact of hard objects with the rubber: pressure, surface, gap, and light in the gap."""
