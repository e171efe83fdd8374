"""What can be wrong with a capture on disk.

CaptureError                  any of these; its message names the file, what is wrong, the likely
│                             cause and what to do
├── CaptureUnreadableError    the file is absent, cut short, or not Parquet / CSV at all
├── CaptureMetadataError      the JSON object beside the samples is absent, of another format version,
│                             or says something impossible (a negative rate, direction 2)
├── CaptureContentError       the samples themselves: a missing column, a wrong type, NaN, no rows,
│                             an axis that the metadata does not describe
└── CaptureChangedError       the bytes are not those whose checksum was stored
"""

from __future__ import annotations

from pathlib import Path


class CaptureError(Exception):
    """A capture cannot be used: ``path`` says which, ``problem`` why, ``advice`` likely cause and cure."""

    def __init__(self, path: Path, problem: str, advice: str) -> None:
        super().__init__(f"{path}: {problem}. {advice}")
        self.path = path
        self.problem = problem
        self.advice = advice


class CaptureUnreadableError(CaptureError):
    """The file cannot be opened or decoded."""


class CaptureMetadataError(CaptureError):
    """The metadata object is missing or impossible."""


class CaptureContentError(CaptureError):
    """The rows are not samples as the format describes them."""


class CaptureChangedError(CaptureError):
    """The file is not the one whose checksum is known."""
