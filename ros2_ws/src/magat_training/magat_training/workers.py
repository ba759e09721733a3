# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The processes that train one policy together: a single one, or those that torchrun starts."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel


@dataclass(frozen=True)
class Workers:
    """This process, among those that train together."""

    rank: int
    count: int
    device: torch.device

    @classmethod
    def join(cls, device: str | None = None) -> "Workers":
        """Join the processes that torchrun started; without torchrun, there is only this one.

        Args:
            device: torch's name of it; if None, GPU number LOCAL_RANK, or the CPU if there is no GPU.
        """
        rank, count = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
        if device is None:
            device = f"cuda:{os.environ.get('LOCAL_RANK', '0')}" if torch.cuda.is_available() else "cpu"
        chosen = torch.device(device)
        if chosen.type == "cuda":
            torch.cuda.set_device(chosen)
        if count > 1 and not distributed.is_initialized():
            distributed.init_process_group("nccl" if chosen.type == "cuda" else "gloo", rank=rank, world_size=count)
        return cls(rank, count, chosen)

    def leave(self) -> None:
        """Leave the group of processes, after the training."""
        if self.count > 1:
            distributed.destroy_process_group()

    @property
    def first(self) -> bool:
        """Whether this process validates and writes files."""
        return self.rank == 0

    def share(self, items: Sequence[Any]) -> Sequence[Any]:
        """This process's part of ``items``."""
        return items[self.rank :: self.count]

    def everyones(self, item: Any) -> list[Any]:
        """``item`` of every process, in the order of ranks; any object that can be pickled."""
        if self.count == 1:
            return [item]
        items: list[Any] = [None] * self.count
        distributed.all_gather_object(items, item)
        return items

    def wait(self) -> None:
        """Wait until all processes are here."""
        if self.count > 1:
            distributed.barrier()

    def wrap(self, network: nn.Module) -> nn.Module:
        """``network`` on the device, with gradients that are averaged over all processes."""
        network = network.to(self.device).to(memory_format=torch.channels_last)
        if self.count == 1:
            return network
        # Without communication (K = 1) some parameters are unused, so torch must look for them. This also keeps the
        # first layout of the gradient buckets. Otherwise the second step changes the layout, three or more processes
        # add up in another order, and a resumed run differs in the last bits.
        devices = [self.device] if self.device.type == "cuda" else None
        return DistributedDataParallel(network, device_ids=devices, find_unused_parameters=True)

    def share_statistics(self, network: nn.Module) -> None:
        """Copy the running statistics of ``network`` from the first process; each process has gathered its own."""
        if self.count > 1:
            for buffer in network.buffers():
                distributed.broadcast(buffer, 0)


#: A single process on the CPU.
ALONE = Workers(0, 1, torch.device("cpu"))
