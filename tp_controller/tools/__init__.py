# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Tools for people: check, recordings, plots, the page in the browser, demonstrations, command line.

They access a running controller only through `ros.client`, and no other package imports them. The
entry point is `cli.main`.
"""
