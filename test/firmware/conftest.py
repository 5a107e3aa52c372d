"""Builds the firmware and the simulated board, and gives a test a bench with both and the package's own link client."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from simulated_board import BUILD, FIRMWARE, SimulatedBoard

from bench import Bench
from sesa2.link import board_client as link_board

if TYPE_CHECKING:
    from bridge_bench import BridgeBench


def make(*arguments: str) -> str:
    """Run make in firmware/; its output, or a failing test."""
    run = subprocess.run(
        ['make', '-s', '-C', FIRMWARE, *arguments], capture_output=True, text=True, check=False
    )
    if run.returncode:
        pytest.fail(f'make -C firmware {" ".join(arguments)}:\n{run.stdout}{run.stderr}', pytrace=False)
    return run.stdout


@pytest.fixture(scope='session')
def built() -> None:
    """Firmware and simulator, built; skips where the machine lacks packages, unless SESA2_REQUIRE_FIRMWARE is set."""
    missing = make('needs').strip() if shutil.which('make') else 'make'
    if missing:
        reason = f'needs the Debian packages {missing}'
        if os.environ.get('SESA2_REQUIRE_FIRMWARE'):
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)
    make('firmware', 'simulator')


@pytest.fixture(scope='session')
def build_variant(built: None) -> Callable[..., SimpleNamespace]:
    """Builds the firmware with other options of its Makefile: build_variant('lcd', 'LCD=1')."""

    def build(name: str, *options: str) -> SimpleNamespace:
        folder = BUILD / name
        make(f'BUILD={folder}', *options, 'firmware')
        return SimpleNamespace(elf=folder / 'sesa2_firmware.elf')

    return build


@pytest.fixture
def new_bench(built: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Bench]]:
    """Makes benches. At the end, no chip may have been used against its datasheet."""
    benches = []

    def new(**options: object) -> Bench:
        simulated = SimulatedBoard(**options)
        benches.append(Bench(simulated))
        monkeypatch.setattr(link_board, 'time', simulated.clock())
        return benches[-1]

    yield new
    violations = [bench.simulated.stats()['violations'] for bench in benches]
    for bench in benches:
        bench.simulated.close()
    assert not any(violations), 'the firmware used a chip against its datasheet'


@pytest.fixture
def bench(new_bench: Callable[..., Bench]) -> Bench:
    """A board whose eight chips have just been given power."""
    return new_bench()


@pytest.fixture
def streaming(bench: Bench) -> Bench:
    """A board that streams all eight chips at 100 Hz, each turning in its own way."""
    bench.boot()
    bench.simulated.set_pattern()
    bench.start()
    return bench


@pytest.fixture
def bridge_bench(built: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator['BridgeBench']:
    """A board whose chips have booted, and a ROS graph for a bridge on it."""
    from bridge_bench import BridgeBench  # the other tests here need no ROS
    from graph_fixtures import ros_graph

    with SimulatedBoard() as simulated:
        with ros_graph() as graph:
            bench = BridgeBench(simulated, graph, tmp_path, monkeypatch.setattr)
            yield bench
        violations = simulated.stats()['violations']
    assert not violations, 'the firmware used a chip against its datasheet'
