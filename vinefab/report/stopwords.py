"""What pictures call the reasons for which branches end."""

from vinefab.model.deployment import Stop

STOP_WORDS = {
    Stop.FULL_LENGTH: "grown in full",
    Stop.HEAD_ON: "stopped head-on",
    Stop.CORNER: "stopped in a corner",
    Stop.NOT_DEPLOYED: "never emerged",
}
