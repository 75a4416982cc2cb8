"""The moves of a search: add one effect, add two at once, exchange one, remove one, replace laws by a free curve.

Every move fits the models that it proposes on trial and compares them by `discrepancy.search.model_comparison`; none of
them changes the search.  `discrepancy.search.loop` makes the moves and keeps what they return.
"""
