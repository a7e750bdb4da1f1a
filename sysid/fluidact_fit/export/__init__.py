"""Parameter files in the languages of controllers."""
