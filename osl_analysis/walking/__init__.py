# SPDX-License-Identifier: Apache-2.0
"""From markers and a moving force plate to the ankle's angle and torque, and to its impedance.

It reads as the experiment goes:

| step | module |
|---|---|
| 1 poses of foot, shank and platform | `poses` |
| 2 platform: motion and onset | `platform` |
| 3 plate: wrench and stance; its own inertia; its lag | `plate`, `plate_inertia`, `plate_lag` |
| 4 angle and torque of a crossing, geometry, set-up | `crossing`, `geometry`, `set_up` |
| 5 window on the phase of stance, 6 isolated response | `isolated_response` |
| 7 K, B, I | `impedance_fit` |
| 8 which crossings count for which result | `groups` |
| 9 results and what speaks against them | `tables` |
"""
