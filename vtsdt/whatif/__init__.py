"""What straightening and lubricating would bring: ``vtsdt what-if``.

Takes from `vtsdt.lift` and `estimation`.
"""
