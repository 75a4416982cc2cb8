"""The search by evidence: models compared by their marginal likelihood, with latent forces in it.

May be imported: every module; `search` has the search itself.  It takes from every room below `questions`.
"""
