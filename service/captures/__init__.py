"""Recorded runs on disk: read, write, check; the exchange format with other people's tools."""

from service.captures.errors import (
    CaptureChangedError,
    CaptureContentError,
    CaptureError,
    CaptureMetadataError,
    CaptureUnreadableError,
)
from service.captures.files import read_capture, sha256, write_capture

__all__ = [
    "CaptureChangedError",
    "CaptureContentError",
    "CaptureError",
    "CaptureMetadataError",
    "CaptureUnreadableError",
    "read_capture",
    "sha256",
    "write_capture",
]
