"""The processes and devices that train one policy together: one on the processor, or those that torchrun starts."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel


@dataclass(frozen=True)
class Workers:
    """This process among those that train together."""

    rank: int
    count: int
    device: torch.device

    @classmethod
    def join(cls, device: str | None = None) -> "Workers":
        """Join those that torchrun started, or be alone.

        Args:
            device: as torch names it; the machine's GPU number LOCAL_RANK, or the processor, if None.
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
        """Part, once the training is over."""
        if self.count > 1:
            distributed.destroy_process_group()

    @property
    def first(self) -> bool:
        """Whether this is the process that validates and writes files."""
        return self.rank == 0

    def share(self, items: Sequence[Any]) -> Sequence[Any]:
        """This process's part of ``items``."""
        return items[self.rank :: self.count]

    def everyones(self, item: Any) -> list[Any]:
        """``item`` of every process, in their order; any object that can be pickled."""
        if self.count == 1:
            return [item]
        items: list[Any] = [None] * self.count
        distributed.all_gather_object(items, item)
        return items

    def wait(self) -> None:
        """Go on when all are here."""
        if self.count > 1:
            distributed.barrier()

    def wrap(self, network: nn.Module) -> nn.Module:
        """``network``, moved to the device, its gradients averaged over all processes."""
        network = network.to(self.device).to(memory_format=torch.channels_last)
        if self.count == 1:
            return network
        # Teams that do not talk leave parameters unused. And looking for those keeps the buckets of gradients as they
        # are laid out first: the second step would lay them out anew, three or more processes would then add up in
        # another order, and a resumed run would not be the same to the bit.
        devices = [self.device] if self.device.type == "cuda" else None
        return DistributedDataParallel(network, device_ids=devices, find_unused_parameters=True)

    def share_statistics(self, network: nn.Module) -> None:
        """Give all the running statistics of the first one's ``network``; each gathers its own from its own batches."""
        if self.count > 1:
            for buffer in network.buffers():
                distributed.broadcast(buffer, 0)


#: A process that trains by itself, on the processor.
ALONE = Workers(0, 1, torch.device("cpu"))
