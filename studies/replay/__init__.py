"""The experiments of the sources, replayed with the models that they identified.

Numbers are those of the thesis and the paper. What they do not give follows from a rule that is
stated on the page, set before the figures were looked at; nothing is tuned to them.
"""
