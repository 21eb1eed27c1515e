# SPDX-License-Identifier: BSD-3-Clause
"""What Snakemake says while a campaign runs: missions done, and the time that the rest takes at the same rate."""

import time

BEGUN_S = time.monotonic()


def log_handler(message):
    if message["level"] == "progress" and message["done"] < message["total"]:
        left = message["total"] - message["done"] - 1  # the last one is rule all
        hours = (time.monotonic() - BEGUN_S) / message["done"] * left / 3600.0
        print(f"Campaign: {message['done']} missions done in this call, {left} left, about {hours:.1f} h to go", flush=True)
