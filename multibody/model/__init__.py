"""A machine as a named graph of components, its network of nodes, its description, and its file.

The class that users build is `multibody.machine.model.Model`, on top of `ModelGraph` here.  Takes from
`multibody.base` and `multibody.declare`.
"""
