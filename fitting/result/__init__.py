"""The result of a reconstruction as one record, with where it comes from; to JSON and back."""
