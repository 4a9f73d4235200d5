"""The lab's commands: arguments and text only."""

from lostmotion.lab.commands.group import lab

__all__ = ["lab"]
