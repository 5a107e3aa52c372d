"""The positions of batched pcc sweeps against a plain loop in C, compiled for the occasion."""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

_SOURCE = Path(__file__).with_suffix('.c')


class MissingCompilerError(RuntimeError):
    """There is no gcc here."""


def pcc_loop():
    """The C function, as (stations, links of a section, their length, length of the last link) → positions."""
    gcc = shutil.which('gcc')
    if gcc is None:
        raise MissingCompilerError('gcc is absent')
    with tempfile.TemporaryDirectory() as directory:
        library = Path(directory) / 'pcc_loop.so'
        subprocess.run([gcc, '-O2', '-shared', '-fPIC', '-o', library, _SOURCE, '-lm'], check=True)
        function = ctypes.CDLL(str(library)).pcc_positions
    array = np.ctypeslib.ndpointer(float, flags='C_CONTIGUOUS')
    function.argtypes = [array, *[ctypes.c_int] * 3, *[ctypes.c_double] * 2, array]
    function.restype = None

    def call(stations, links, length, rest):
        sweeps, n, _ = stations.shape
        positions = np.empty((sweeps, (n - 1) * links + 2, 3))
        function(stations, sweeps, n - 1, links, length, rest, positions)
        return positions

    return call
