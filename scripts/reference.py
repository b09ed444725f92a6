"""Prints the help of every command as a page of the book: reference.py PROGRAM."""

import re
import subprocess
import sys


def text_of(program: str, *words: str) -> str:
    """The whole help of a command."""
    done = subprocess.run([program, *words, "--help"], capture_output=True, text=True, check=True)
    return done.stdout.rstrip()


def commands_of(text: str) -> list[str]:
    """The names of the commands that a help lists."""
    if "<COMMAND>" not in text:
        return []
    # Under headings, before the options.
    listed = text.split("\nOptions:\n")[0]
    names = re.findall(r"^  ([a-z][\w-]*)  ", listed, re.MULTILINE)
    return [name for name in names if name != "help"]


def main() -> None:
    """Writes the page to the standard output."""
    program = sys.argv[1]
    print("# Options of the commands\n\nThe help of every command, as `quadlift COMMAND --help` prints it.")
    text = text_of(program)
    print(f"\n```text\n{text}\n```")
    for command in commands_of(text):
        text = text_of(program, command)
        print(f"\n## {command}\n\n```text\n{text}\n```")
        for inner in commands_of(text):
            print(f"\n### {command} {inner}\n\n```text\n{text_of(program, command, inner)}\n```")


if __name__ == "__main__":
    main()
