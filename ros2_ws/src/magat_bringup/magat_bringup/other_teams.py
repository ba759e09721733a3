# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Teams that were not started by this run, by hand or by launch, in the ROS domain that it is to use."""

from magat_bringup.environment import NoDomainError, occupied
from magat_node.visitor import Visitor

#: How long to look for another simulator, seconds. On one machine, nodes find each other in a fraction of that.
PATIENCE = 2.0


def refuse_other_team(domain: int, namespace: str) -> None:
    """Make sure that this machine has no simulator in ``namespace`` of ROS domain ``domain``.

    Such a simulator would serve the episodes of this run, with robots of its own.

    Raises:
        NoDomainError: it has one.
    """
    if not occupied(domain):
        return
    name = ("simulator", namespace or "/")
    with Visitor("looking", domain=domain) as visitor:
        if visitor.spin(lambda: name in visitor.node.get_node_names_and_namespaces(), PATIENCE):
            where = f" under the namespace {namespace}" if namespace else ""
            raise NoDomainError(
                f"a team runs in the ROS domain {domain}{where} already: give another domain or namespace, or none"
            )
