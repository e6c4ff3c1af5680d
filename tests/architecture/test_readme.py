"""The two commands of the README are one line each, and CI runs the very same lines."""

import re
import subprocess


def commands(root) -> list[str]:
    blocks = re.findall(r"```(?:sh|bash)\n(.*?)```", (root / "README.md").read_text(encoding="utf-8"), re.S)
    return [block.strip() for block in blocks]


def test_the_first_two_blocks_are_the_two_commands(root):
    job, tests = commands(root)[:2]
    for line in (job, tests):
        assert "\n" not in line
        assert line.startswith("python3 -m venv .venv && .venv/bin/python -m pip install -q ")
        assert "/bin/ema" in line or line.endswith("-m pytest")
    assert job.endswith("ema run reports/table_placement.toml")
    assert tests.endswith(".venv/bin/python -m pytest")


def test_ci_finds_both_commands_in_the_readme(root):
    script = root / ".ci" / "run"
    assert script.stat().st_mode & 0o111, "the CI script is executable"
    listed = subprocess.run(
        ["bash", str(script), "--list"], cwd=root, capture_output=True, text=True, timeout=60, check=True
    )
    assert listed.stdout.splitlines() == commands(root)[:2]


def test_pictures_of_the_readme_exist(root):
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", (root / "README.md").read_text(encoding="utf-8"))
    assert pictures
    for picture in pictures:
        assert (root / picture).is_file(), picture
