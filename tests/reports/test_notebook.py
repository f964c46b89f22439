"""Meshes in the cells of notebooks: a kernel that runs one, and the cell in a real browser."""

import io
import json
import sys
from base64 import b64decode
from contextlib import closing

import numpy as np
import pytest
from browsers import Browser, needs_browser
from PIL import Image
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.reports import notebook

ROUGH = noisy(icosphere(3), 0.2)
SMOOTH = cn.denoise(ROUGH, method="laplacian")


def scene_of(widget) -> dict:
    """What the viewer of a widget shows."""
    return json.loads(widget.page.split('id="scene">')[1].split("</script>")[0])


def picture_of(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)


def test_a_cell_has_a_widget_and_a_still_picture():
    data, _ = cn.view(ROUGH, SMOOTH)._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in data
    still = picture_of(b64decode(data["image/png"]))
    assert still.shape[1] > 2 * notebook.VIEW_PICTURE
    left, right = still[:, : notebook.VIEW_PICTURE], still[:, -notebook.VIEW_PICTURE :]
    spread = [np.abs(np.diff(half[100:300, 100:300], axis=1)).mean() for half in (left, right)]
    assert spread[0] > 2 * spread[1] > 0  # the noisy mesh is the one of many shades


def test_a_view_shows_the_meshes_that_are_given():
    assert [mesh["name"] for mesh in scene_of(cn.view(ROUGH))["meshes"]] == ["mesh"]
    assert [mesh["name"] for mesh in scene_of(cn.view(ROUGH, SMOOTH))["meshes"]] == ["before", "after"]
    against = scene_of(cn.view(ROUGH, truth=icosphere(3)))
    assert [mesh["name"] for mesh in against["meshes"]] == ["before", "truth"]
    assert "normal-error" in [field["name"] for field in against["fields"]]


def test_a_view_takes_files_and_meshes_of_other_libraries(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    save_mesh(tmp_path / "rough.ply", ROUGH)
    other = trimesh.Trimesh(SMOOTH.vertices, SMOOTH.faces, process=False)
    shown = scene_of(cn.view(tmp_path / "rough.ply", other, height=300))
    assert [mesh["faces"] for mesh in shown["meshes"]] == [1280, 1280]


@pytest.mark.parametrize("at", ["vertex", "face"])
def test_values_of_ones_own_are_shown_on_vertices_or_faces(at):
    values = np.arange(len(ROUGH.vertices if at == "vertex" else ROUGH.faces), dtype=float) - 100
    values[3] = np.nan
    widget = cn.view(ROUGH, SMOOTH, values=values)
    (own,) = [field for field in scene_of(widget)["fields"] if field["name"] == "values"]
    assert own["at"] == at and own["signed"] and set(own["of"]) == {"before", "after"}
    assert 'location.hash = "color=values"' in widget.page
    plain = picture_of(cn.view(ROUGH, SMOOTH).picture)
    assert (np.abs(picture_of(widget.picture) - plain) > 30).mean() > 0.1  # colours in the still picture as well


def test_values_that_cannot_be_shown_are_refused():
    with pytest.raises(cn.ParameterError, match=r"values is 'hue'; it must be one of angle, displacement"):
        cn.view(ROUGH, values="hue")
    with pytest.raises(cn.ParameterError, match=r"displacement compares a mesh with another one: give `other`"):
        cn.view(ROUGH, values="displacement")
    with pytest.raises(cn.ParameterError, match=r"distance compares a mesh with another one: give `truth`"):
        cn.view(ROUGH, SMOOTH, values="distance")
    with pytest.raises(cn.ParameterError, match=r"values have shape \(7,\); the mesh has 642 vertices and 1,280 faces"):
        cn.view(ROUGH, values=np.zeros(7))
    with pytest.raises(cn.ParameterError, match="values are not an array of real numbers"):
        cn.view(ROUGH, values=["red", "blue"])
    with pytest.raises(cn.ParameterError, match="give `other`, with the same faces, as well"):
        cn.view(ROUGH, icosphere(1), values="displacement")


def test_none_is_no_mesh_to_view():
    with pytest.raises(cn.MeshError, match="NoneType is not a supported kind of mesh"):
        cn.view(None)


def test_a_view_without_anywidget_says_what_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    notebook._widget.cache_clear()
    with pytest.raises(cn.MissingDependencyError, match=r"cascadenorm\[notebook\]"):
        cn.view(ROUGH)
    monkeypatch.undo()
    notebook._widget.cache_clear()
    assert cn.view(ROUGH).height == 520


def test_a_mesh_describes_itself_with_a_picture():
    html = ROUGH._repr_html_()
    assert "642 vertices, 1,280 faces" in html
    drawn = picture_of(b64decode(html.split("base64,")[1].split('"')[0]))
    assert drawn.shape == (notebook.MESH_PICTURE, notebook.MESH_PICTURE, 3)
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 50


@pytest.mark.parametrize(
    "mesh",
    [grid(2, 2), Mesh(np.ones((3, 3)), [[0, 1, 2]]), Mesh(np.eye(3) * 1e300, [[0, 1, 2]])],
    ids=["flat", "in one place", "huge"],
)
def test_every_mesh_describes_itself(mesh):
    assert f"{len(mesh.vertices)} vertices" in mesh._repr_html_()


def test_a_large_mesh_describes_itself_in_words(monkeypatch):
    monkeypatch.setattr(notebook, "MOST_FACES_IN_CELL", 100)
    assert "<img" not in ROUGH._repr_html_() and "1,280 faces" in ROUGH._repr_html_()
    assert "<img" in cube(2)._repr_html_()


CELLS = """\
import cascadenorm as cn
mesh = cn.read("rough.ply").mesh
---
with cn.progress_bar() as progress:
    smooth = cn.denoise(mesh, method="laplacian", progress=progress)
---
mesh
---
cn.view(mesh, smooth, values="normal-displacement")
"""


@pytest.mark.slow  # a kernel of Jupyter, which imports all libraries anew; other tests render the outputs here
def test_a_kernel_runs_a_notebook(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    save_mesh(tmp_path / "rough.ply", ROUGH)
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in CELLS.split("---\n")])
    place = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(book, timeout=None, startup_timeout=24 * 3600, resources=place).execute()
    _, bar, described, viewed = (cell["outputs"] for cell in book["cells"])
    assert all(output["output_type"] != "error" for cell in book["cells"] for output in cell["outputs"])
    assert "application/vnd.jupyter.widget-view+json" in bar[0]["data"]  # tqdm.auto takes the bar of notebooks
    assert "1,280 faces" in described[0]["data"]["text/html"]
    data = viewed[0]["data"]
    assert picture_of(b64decode(data["image/png"])).std() > 10
    number = data["application/vnd.jupyter.widget-view+json"]["model_id"]
    states = book["metadata"]["widgets"]["application/vnd.jupyter.widget-state+json"]["state"]
    assert states[number]["state"]["page"].startswith("<!doctype html>")


@pytest.fixture(scope="module")
def browser():
    with closing(Browser()) as opened:
        yield opened


CELL = """<!doctype html><meta charset="utf-8"><body style="margin: 20px"><div id="cell"></div>
<script type="application/json" id="state">{state}</script>
<script type="module">
const state = JSON.parse(document.getElementById("state").textContent);
const code = URL.createObjectURL(new Blob([state._esm], {{type: "text/javascript"}}));
const {{ default: widget }} = await import(code);
widget.render({{ model: {{ get: (name) => state[name] }}, el: document.getElementById("cell") }});
</script>"""
"""What a front end does with a widget: it imports its module and lets it render what Python has sent."""


def opened_cell(browser, folder, widget):
    state = {name: widget.get_state()[name] for name in ("_esm", "page", "height")}
    text = json.dumps(state).replace("<", "\\u003c")
    (folder / "cell.html").write_text(CELL.format(state=text), encoding="utf-8")
    browser.driver.get_log("browser")
    browser.driver.get((folder / "cell.html").as_uri())
    for _ in range(400):
        ready = browser.js(
            "const f = document.querySelector('iframe');"
            "return f && f.contentDocument && f.contentDocument.getElementById('viewer')?.dataset.state"
        )
        if ready:
            break
        browser.settle()
    assert ready == "ready"
    browser.settle()


@needs_browser
@pytest.mark.parametrize("values", [None, "displacement"])
def test_the_cell_draws_the_meshes(browser, tmp_path, values):
    browser.sized(1000, 700)
    opened_cell(browser, tmp_path, cn.view(ROUGH, SMOOTH, values=values, height=500))
    picture = browser.pixels("iframe")
    assert picture.shape[0] == 500
    middle = picture[150:350, 200:480]
    assert len(np.unique(middle.reshape(-1, 3), axis=0)) > 200  # no blank canvas
    colorful = (np.ptp(middle, axis=2) > 60).mean()
    assert colorful > 0.3 if values else colorful < 0.05  # a heat map, or clay
    complaints = [entry for entry in browser.driver.get_log("browser") if entry["level"] == "SEVERE"]
    assert complaints == []


@needs_browser
def test_a_cell_offers_only_what_leads_to_the_view_again(browser, tmp_path):
    """A frame has no address, and a mesh in memory no file."""
    save_mesh(tmp_path / "rough.ply", ROUGH)
    for mesh, offers in (
        (ROUGH, {"Reset view"}),
        (tmp_path / "rough.ply", {"Reset view", "Copy view as command line"}),
    ):
        opened_cell(browser, tmp_path, cn.view(mesh))
        browser.driver.switch_to.frame(0)
        buttons = browser.driver.find_elements("css selector", ".panel > section > .buttons button")
        assert {button.text for button in buttons if button.is_displayed()} == offers
        browser.driver.switch_to.default_content()


@needs_browser
def test_the_cell_draws_again_when_it_is_turned(browser, tmp_path):
    browser.sized(1000, 700)
    opened_cell(browser, tmp_path, cn.view(cube(3)))
    before = browser.pixels("iframe")
    browser.driver.switch_to.frame(0)
    browser.one("canvas").send_keys("\ue012" * 4)  # left arrow
    browser.driver.switch_to.default_content()
    browser.settle()
    browser.js("return new Promise((done) => setTimeout(done, 500))")  # past the time when an address would be written
    assert (np.abs(browser.pixels("iframe") - before) > 10).mean() > 0.05
    assert [entry for entry in browser.driver.get_log("browser") if entry["level"] == "SEVERE"] == []
