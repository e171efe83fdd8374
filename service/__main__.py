"""``python -m service`` is ``flankwatch``."""

from service.cli import main

if __name__ == "__main__":
    main()
