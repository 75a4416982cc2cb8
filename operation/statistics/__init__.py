"""Statistics of a history on arrays: changes and their false alarms, posteriors with drift, what a fleet says.

`control_chart` finds changes at a stated rate of false alarms, `local_level` updates a parameter from record to
record, `fleet_prior` and `share_level` say what many machines have in common.  Takes nothing.
"""
