"""What people type: commands, options and their values."""
