# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where a team's messages may go: domains, ports, the discovery server, and what is told to processes."""

import os
import socket
import subprocess
import sys
import tempfile
from unittest import mock

import pytest

from magat_bringup import discovery
from magat_bringup.environment import (
    DOMAINS,
    LOOPBACK,
    MOST_PEERS,
    Network,
    NetworkError,
    NoDomainError,
    address_of,
    loopback,
    network_for,
    occupied,
    own_domain,
)
from magat_cli.main import main

#: What a shell may say that would lead messages elsewhere.
ELSEWHERE = {
    "ROS_DISCOVERY_SERVER": "192.0.2.1:11811",
    "ROS_LOCALHOST_ONLY": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "FASTRTPS_DEFAULT_PROFILES_FILE": "/nowhere.xml",
    "MAGAT_ADDRESS": "192.0.2.1",
    "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
    "ROS_DOMAIN_ID": "7",
}


def test_by_default_nothing_that_a_shell_says_leads_messages_off_the_machine():
    variables = loopback(3)
    assert variables.keys() >= ELSEWHERE.keys()
    assert not variables.items() & ELSEWHERE.items()
    assert (variables["MAGAT_ADDRESS"], variables["ROS_DISCOVERY_SERVER"]) == (LOOPBACK, "")


def test_processes_use_the_interface_that_leads_to_the_server():
    network = Network(21, "localhost")
    assert network.address == LOOPBACK
    assert network.variables["ROS_DISCOVERY_SERVER"] == f"localhost:{network.port}"
    with mock.patch.object(socket.socket, "getsockname", return_value=("10.1.2.3", 5)):
        assert Network(21, "localhost").variables["MAGAT_ADDRESS"] == "10.1.2.3"
    with pytest.raises(NetworkError, match=r"discovery server 'nowhere\.invalid' .*: give its host's name"):
        Network(21, "nowhere.invalid").variables.items()


def test_tools_see_all_that_a_server_knows():
    assert Network(21, LOOPBACK).tool_variables == Network(21, LOOPBACK).variables | {"ROS_SUPER_CLIENT": "TRUE"}
    assert Network(21).tool_variables == Network(21).variables


def test_ports_of_servers_and_of_domains_do_not_meet():
    def ports_of_processes(domain):
        # RTPS: 10 and 11 from a domain's first port on for the first process, and 0 and 1 for multicast.
        first = 7400 + 250 * domain
        return {first, first + 1, *range(first + 10, first + 10 + 2 * 240)}

    used = [ports_of_processes(domain) | {Network(domain, LOOPBACK).port} for domain in DOMAINS]
    assert sum(map(len, used)) == len(set.union(*used)) == len(DOMAINS) * (2 + 2 * 240 + 1)
    assert max(set.union(*used)) < 32768  # from there on, Linux hands them out


def test_a_large_team_has_a_server_and_one_that_is_opened_too():
    assert network_for(5, MOST_PEERS) == Network(5)
    assert network_for(5, MOST_PEERS + 1) == Network(5, LOOPBACK)
    assert network_for(5, 4, interface="lo") == network_for(5, 4, interface=LOOPBACK) == Network(5, LOOPBACK)
    with pytest.raises(NetworkError, match=r"no interface 'wlan77' .*: it has .*lo \(127\.0\.0\.1\)"):
        address_of("wlan77")
    with pytest.raises(NetworkError, match=r"no interface '192\.0\.2\.77'"):
        network_for(5, 4, interface="192.0.2.77")


def test_a_domain_is_one_runs_alone():
    with own_domain() as domain, own_domain() as other:
        assert domain != other
        assert {domain, other} <= set(DOMAINS)
        with pytest.raises(NoDomainError, match=f"domain {domain} is in use"), own_domain(domain):
            pass
    with own_domain(domain) as again:
        assert again == domain


def test_teams_of_different_namespaces_can_share_a_domain():
    with own_domain() as domain:
        pass
    taken = f"domain {domain} is in use .* under the namespace /red"
    with (
        own_domain(domain, "/red"),
        own_domain(domain, "/blue"),
        own_domain(domain),
        pytest.raises(NoDomainError, match=taken),
        own_domain(domain, "/red"),
    ):
        pass


def test_a_claim_leaves_no_file_that_would_lock_out_another_user(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    with own_domain():
        assert list(tmp_path.iterdir()) == []


def test_a_claim_ends_with_its_process_however_that_ends():
    program = "from magat_bringup.environment import own_domain\nwith own_domain() as d: print(d, flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", program], stdin=-1, stdout=-1, text=True) as run:
        domain = int(run.stdout.readline())
        with pytest.raises(NoDomainError), own_domain(domain):
            pass
        run.kill()
        run.wait()
    with own_domain(domain):
        pass


def test_domains_in_which_somebody_has_a_node_are_left_alone():
    with own_domain() as domain, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as node:
        assert not occupied(domain)
        node.bind((LOOPBACK, 7400 + 250 * domain + 14))  # of a third process; the first two have ended
        assert occupied(domain)
    used = {7400 + 250 * other + 10 for other in DOMAINS if other != domain}
    with mock.patch("magat_bringup.environment._bound_ports", return_value=used), own_domain() as free:
        assert free == domain
        with pytest.raises(NoDomainError, match="are all in use"), own_domain():
            pass


def test_a_shell_takes_the_environment_as_it_is_printed():
    command = f'eval "$({sys.executable} -m magat_cli env --domain 21 --server localhost --tools)" && env -0'
    printed = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True, timeout=60).stdout
    said = dict(line.split("=", 1) for line in printed.split("\0") if line)
    assert said.items() >= Network(21, "localhost").tool_variables.items()


@pytest.mark.parametrize("domain", ["-1", "102", "one"])
def test_a_domain_that_is_none_is_refused(domain, capsys):
    with pytest.raises(SystemExit):
        main(["env", "--domain", domain])
    assert "--domain" in capsys.readouterr().err


def test_a_server_without_an_address_says_what_to_do(capsys):
    with mock.patch.dict(os.environ, loopback(3)):
        assert discovery.main() == 1
    assert 'eval "$(magat env --server ADDRESS)"' in capsys.readouterr().err
    with mock.patch.dict(os.environ, Network(3, LOOPBACK).variables | {"PATH": "/nowhere"}):
        assert discovery.main() == 1
    assert "is part of Fast DDS" in capsys.readouterr().err
