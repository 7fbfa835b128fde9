"""From markers and a moving force plate to the ankle's angle and torque, and to its impedance.

It reads as the experiment goes:

| step | module |
|---|---|
| 1 poses of foot, shank and platform | `poses` |
| 2 platform and plate: motion and onset, wrench, the plate's own inertia | `platform`, \
`mean_ramp`, `plate`, `plate_model` |
| 3 stance | `stance`, `passage` |
| 4 angle and torque | `ankle`, `torque_errors`, `crossing` |
| 5 window on the phase of stance | `unperturbed_gait` |
| 6 isolated response | `isolated_response` |
| 7 K, B, I | `impedance_fit`, `ensemble` |

Around it: which crossings are used (`setup_checks`, `crossing_quality`, `selection`), and for which
result (`groups`); what speaks against a result (`group_checks`, `alike`); tables (`result_tables`,
`group_table`).
"""
