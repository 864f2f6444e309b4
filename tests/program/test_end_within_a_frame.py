"""A process that ends while threads of its own draw ends as any other."""

import os
import subprocess
import sys

from support.checkout import ROOT
from support.patience import PATIENCE

# What is registered first is called last, when static objects are gone: threads of C++ draw on until then.
ENDING = """
import ctypes, sys, threading
c = ctypes.CDLL(None)
c.__cxa_atexit(ctypes.cast(c.usleep, ctypes.c_void_p), ctypes.c_void_p(300_000), None)

import numpy as np
from support.scenes.arbitrary import plain_scene
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import View

def draw():
    single = SingleProcess(np.random.default_rng(1).random((128, 128, 128), np.float32), threads=3)
    scene = plain_scene(opacity=0.01, view=View(zoom=6.0), size=(1000, 1000))
    for _ in single.refine(scene, Step.F, first=Step.F, partial_interval=0.02):
        drawing.set()

drawing = threading.Event()
threading.Thread(target=draw, daemon=True).start()
sys.exit(0 if drawing.wait() else 1)
"""


def test_a_process_may_end_within_a_frame() -> None:
    freed_is_spoilt = {"MALLOC_PERTURB_": "90"}
    command = [sys.executable, "-W", "ignore", "-c", ENDING]
    ended = subprocess.run(command, env=os.environ | freed_is_spoilt, cwd=ROOT / "tests", timeout=PATIENCE)
    assert ended.returncode == 0
