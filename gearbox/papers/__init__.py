"""The gearbox paper's tables and figures made again and compared; Eq. 18 is in `eq_18_response_surface`.

`vtsdt validate papers` calls `gearbox.papers.gearbox.chapters`.  Takes from every other room of the gearbox.
"""
