"""The reduced model: a projection of the problem that holds over an interval or a box of parameters."""

from .box import BoxModel
from .estimate import OnlineModel
from .model import ReducedModel
from .sharper import SharperModel
from .transferred import TransferredModel
from .vectors import SlowMotions

__all__ = ["BoxModel", "OnlineModel", "ReducedModel", "SharperModel", "SlowMotions", "TransferredModel"]
