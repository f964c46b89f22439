"""Memory that reading a mesh takes in each format, into docs/files.md.

    python -m benchmarks.speed.file_memory

Each file is read in a process of its own. What the process has before is given apart: Python, its libraries, and the
package, whose kernels are compiled before. The table has what reading adds at its peak.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.speed.speed import wavy_torus
from cascadenorm import io
from cascadenorm.io.interop import save_mesh

PAGE = Path(__file__).parents[2] / "docs" / "files.md"
BEGIN, END = "<!-- memory: written by benchmarks/speed/file_memory.py -->", "<!-- end of memory -->"
STEPS = 1000, 500
"""Of the torus: 1,000,000 faces."""
FORMATS = {
    "PLY, binary": "ply",
    "GLB": "glb",
    "OFF": "off",
    "OBJ": "obj",
    "PLY, text": "text.ply",
    "STL, binary": "stl",
}
READ = """
import sys
from pathlib import Path
import cascadenorm as cn

def megabytes(name):
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) * 1024 / 1e6

cn.read(sys.argv[1]).mesh  # a small file of the format: libraries and kernels are there from now on
before = megabytes("VmRSS")
Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # proc(5): resets the peak
file = cn.read(sys.argv[2])
mesh = file.mesh
print(before, megabytes("VmHWM") - before)
"""


def as_text(source: Path, target: Path) -> None:
    """Write a PLY file as text."""
    mesh = io.read(source).mesh
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(mesh.vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    vertices = (f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in mesh.vertices.astype("f4").tolist())
    faces = (f"3 {a} {b} {c}\n" for a, b, c in mesh.faces.tolist())
    target.write_text(head + "".join(vertices) + "".join(faces), encoding="ascii")


def main() -> None:
    """Measure each format, and write the table."""
    with tempfile.TemporaryDirectory() as folder:
        place, large, small = Path(folder), wavy_torus(*STEPS), wavy_torus(20, 10)
        rows, starts = [], []
        for title, extension in FORMATS.items():
            files = [place / f"{name}.{extension}" for name in ("small", "large")]
            for path, mesh in zip(files, (small, large), strict=True):
                if extension == "text.ply":
                    as_text(path.with_name(path.name.replace(".text", "")), path)
                else:
                    save_mesh(path, mesh)
            found = subprocess.run([sys.executable, "-c", READ, *files], stdout=subprocess.PIPE, text=True, check=True)
            before, more = map(float, found.stdout.split())
            starts.append(before)
            rows.append((more, f"| {title} | {files[1].stat().st_size / 1e6:.0f} MB | {more:.0f} MB |"))
    lines = ["| file | size | memory |", "| --- | ---: | ---: |", *(line for _, line in sorted(rows))]
    start = f"{min(starts):.0f} to {max(starts):.0f} MB of the program itself"
    text = f"Beyond the {start}, reading a mesh of 1,000,000 triangles takes at most\n\n" + "\n".join(lines)
    print(text)
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(re.sub(f"{BEGIN}.*{END}", f"{BEGIN}\n{text}\n{END}", page, flags=re.DOTALL), encoding="utf-8")


if __name__ == "__main__":
    main()
