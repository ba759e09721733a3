# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The learned policy, free of ROS. Nothing is imported here: each module costs what it says.

The science (torch):

- `extractor`: the CNN
- `graph`: the graph layers, registered in `layers` (free of torch)
- `network`: the whole network, for training and in fixed point
- `fixed_point`: exact arithmetic; its constants are in `grids` (free of torch)

On a robot (numpy and onnxruntime; torch only in `policy`):

- `config`: `PolicyConfig`, read from a policy's name and file; without numpy, too
- `interface`: `RobotPolicy`, what each backend implements
- `backends`: makes a `RobotPolicy` of a folder, by the backend's name
- `computed`: what the backends with a network share: attention, and decisions of many robots together
- `onnx_policy`, `policy`, `echo_policy`: the backends onnx, torch and echo
- `latent_cache`: skips the CNN for fields of view that have not changed
- `sampling`: draws actions
- `visit_memory`: what a robot remembers of its own path, and how that changes its decision
- `payload`: encodes messages

Files:

- `models`: finds policy folders by name or digest
- `folder`: reads and checks the files of one policy folder, without torch
- `store`: saves and loads weights, with torch
- `export`: writes the files of the onnx backend
"""
