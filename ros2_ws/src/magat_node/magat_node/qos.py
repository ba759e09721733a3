# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Qualities of service; `magat_node.topics` says which topic has which."""

from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy


def newest(depth: int) -> QoSProfile:
    """Best effort, for the messages of a tick: a lost message would be too late if it were sent again."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def reliable(depth: int) -> QoSProfile:
    """Lost messages are sent again; for tools."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.RELIABLE)


def latched(depth: int) -> QoSProfile:
    """Reliable, and a late subscriber gets the last messages."""
    return QoSProfile(
        depth=depth, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
    )
