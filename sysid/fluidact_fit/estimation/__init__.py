"""The estimation core: shared by all families and ignorant of them."""
