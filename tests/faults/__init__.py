"""Faults by kinds, each with a generator of cases, and what it takes to survive one."""
