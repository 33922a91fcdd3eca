"""What people write and read: errors, files, units, numbers in words, tables, JSON records."""
