"""The gearbox paper's tables made again and compared.

Takes from every other room of the gearbox.
"""
