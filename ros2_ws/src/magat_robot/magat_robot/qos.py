"""Quality of service of the team's topics; docs/protocol.md is the same table in words."""

from rclpy.qos import QoSProfile, QoSReliabilityPolicy


def newest(depth: int) -> QoSProfile:
    """Best effort: what is lost is not sent again, since the next tick makes it worthless. For the tick's own messages."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def reliable(depth: int) -> QoSProfile:
    """Lost messages are sent again. For what people and tools watch."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.RELIABLE)
