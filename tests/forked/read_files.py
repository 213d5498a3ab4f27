"""Files of each kind, read once: what checks them is made when the first one is read."""

from labapp.files.bench_file import BenchFile
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled_path, read_file
from labapp.files.scene_file import SceneFile

read_file(bundled_path("bench.toml"), BenchFile)
read_file(bundled_path("scene.toml"), SceneFile)
read_file(bundled_path("plans/photon-transfer.toml"), PlanFile)
