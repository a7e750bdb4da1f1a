"""The experiments of the sources, replayed with the models that they identified.

Numbers are those of the thesis and the paper. What they do not give follows from a rule that is
stated on the page. Some rules take a figure that the page then compares: every line says so.
"""
