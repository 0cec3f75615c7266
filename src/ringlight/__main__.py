"""``python -m ringlight``: the command, where its script is not on the path."""

from ringlight.cli.main import main

if __name__ == "__main__":
    main()
