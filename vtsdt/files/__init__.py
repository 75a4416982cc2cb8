"""The numbers of a lift in files: parameters and rail profiles.

Takes from `multibody.base`.
"""
