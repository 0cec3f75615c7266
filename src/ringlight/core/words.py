"""Numbers with their noun, in sentences for people."""


def counted(number: int, noun: str) -> str:
    """ "1 step", "3,000 steps"; for nouns whose plural takes an s."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"
