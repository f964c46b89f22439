"""Reading, writing and Taubin smoothing by one library: PYTHON benchmarks/speed/peer_files.py LIBRARY PAIRS

PAIRS of steps are smoothed. Serves requests, one a line: `read PATH`, `write PATH`, `replace PATH`, `smooth`. All but
the first are about the mesh read last, which `write` writes anew and `replace` with other positions, else as it was
read; STL is text where its name ends in text.stl. Each is answered by the seconds of processor time that it took, or by
what went wrong. Nothing of this project is imported here unless it is the library.
"""

import os
import sys
import time

MISSING = 3
"""Exit status where the library is not installed."""


def is_text(path):
    """Whether a path stands for an STL file in text form."""
    return path.endswith("text.stl")


def cascadenorm(pairs):
    """Read with all checks, seams closed."""
    import cascadenorm as cn
    from cascadenorm.io import from_arrays

    def read(path):
        file = cn.read(path)
        file.mesh  # noqa: B018  made when first asked for
        return file

    def write(file, path):
        cn.write(from_arrays(file.mesh.vertices, file.mesh.faces), path, force=True)

    def replace(file, path):
        cn.write(file.with_vertices(file.mesh.vertices * 1.25), path, force=True)

    return read, write, replace, lambda file: cn.denoise(file.mesh, method="taubin", iterations=pairs)


def trimesh(pairs):
    """Close only the seams of STL; in other formats that would also join other vertices."""
    import trimesh

    return (
        lambda path: trimesh.load_mesh(path, process=path.endswith("stl")),
        lambda mesh, path: mesh.export(path, file_type="stl_ascii" if is_text(path) else None),
        lambda mesh: trimesh.smoothing.filter_taubin(mesh.copy(), iterations=2 * pairs),
    )


def meshio(_):
    """Close no seams: meshio has no function for that."""
    import meshio

    def write(mesh, path):
        mesh.write(path, **({"binary": not is_text(path)} if path.endswith("stl") else {}))

    return meshio.read, write, None


def pyvista(pairs):
    """STL is read without seams by default."""
    import pyvista

    return (
        pyvista.read,
        lambda mesh, path: mesh.save(path, binary=not is_text(path)),
        lambda mesh: mesh.smooth_taubin(n_iter=2 * pairs),
    )


def open3d(pairs):
    """Close the seams of STL, and compute the normals that Open3D needs to write it."""
    from open3d.io import read_triangle_mesh, write_triangle_mesh

    def read(path):
        mesh = read_triangle_mesh(path)
        return mesh.remove_duplicated_vertices() if path.endswith("stl") else mesh

    def write(mesh, path):
        if path.endswith("stl"):
            mesh.compute_triangle_normals()
        if is_text(path) or not write_triangle_mesh(path, mesh):  # STL is never text
            raise ValueError("nothing was written")

    return read, write, lambda mesh: mesh.filter_smooth_taubin(pairs)


def pymeshlab(pairs):
    """STL is read without seams by default."""
    import pymeshlab

    def read(path):
        meshes = pymeshlab.MeshSet()
        meshes.load_new_mesh(path)
        return meshes

    return (
        read,
        lambda meshes, path: meshes.save_current_mesh(path, **({"binary": False} if is_text(path) else {})),
        lambda meshes: meshes.apply_coord_taubin_smoothing(stepsmoothnum=pairs),
    )


LIBRARIES = {function.__name__: function for function in (cascadenorm, trimesh, meshio, pyvista, open3d, pymeshlab)}


def main():
    """Serve requests until there are no more."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what libraries print
    try:
        read, write, *replace, smooth = LIBRARIES[sys.argv[1]](int(sys.argv[2]))
    except ImportError:
        sys.exit(MISSING)
    verbs = {"write": write, "replace": replace[0] if replace else write, "smooth": smooth}
    mesh = None
    for line in sys.stdin:
        verb, *path = line.rstrip().split(" ", 1)
        if verb == "read":
            mesh = None  # not two at a time
        start = time.process_time()
        try:
            if verb == "read":
                mesh = read(*path)
            else:
                verbs[verb](mesh, *path)
            answers.write(f"{time.process_time() - start}\n")
        except Exception as error:  # whatever another library raises
            answers.write(f"{type(error).__name__}: {' '.join(str(error).split())}\n")


if __name__ == "__main__":
    main()
