"""Chi square of an objective at any parameters, and searches that lower it side by side."""
