"""nerfmodal: modal parameters of vibrating plants and structures from ordinary RGB cameras.

Importing this package imports nothing heavy; take what you need from its modules.
"""

from importlib.metadata import version

__version__ = version("nerfmodal")
