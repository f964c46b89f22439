"""Files of VTK that declare more than they hold, or other cells than they hold, are refused before VTK reads them."""

import base64
import re

import pytest
from mixed_sheet import SHEET, surface
from sample_files import read

from cascadenorm import io


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("mode", ["inline", "appended", "raw"])
@pytest.mark.parametrize("word", [4, 8])
def test_arrays_of_polydata_that_declare_more_than_the_file_holds_are_refused(packed, mode, word, tmp_path, capfd):
    """VTK would end the process for want of memory."""
    pyvista = pytest.importorskip("pyvista")
    vtk = pytest.importorskip("vtkmodules.vtkIOXML")
    writer, path = vtk.vtkXMLPolyDataWriter(), tmp_path / "a.vtp"
    writer.SetFileName(str(path))
    writer.SetInputData(surface(pyvista))
    writer.SetDataModeToBinary() if mode == "inline" else writer.SetDataModeToAppended()
    writer.SetEncodeAppendedData(mode == "appended")
    writer.SetHeaderTypeToUInt32() if word == 4 else writer.SetHeaderTypeToUInt64()
    if not packed:
        writer.SetCompressorTypeToNone()
    writer.Write()
    data = path.read_bytes()
    assert len(read(data, "vtp").positions) == len(SHEET.vertices)
    before = rb"<DataArray[^>]*>\s*" if mode == "inline" else rb"<AppendedData[^>]*>\s*_"
    start = re.search(before, data).end()
    coded = data[start : start + 4 * word]  # of three words in base64
    for place in range(3 if packed else 1):  # the number of blocks, the size of a block, that of the last one
        words = bytearray(coded[: 3 * word] if mode == "raw" else base64.b64decode(coded))
        words[place * word : (place + 1) * word] = (2 ** (8 * word - 4)).to_bytes(word, "little")
        new = bytes(words) if mode == "raw" else base64.b64encode(words)
        with pytest.raises(io.ReadError, match=r"declares more bytes than the file has|the arrays of this file need"):
            read(data[:start] + new + data[start + len(new) :], "vtp")
    assert capfd.readouterr() == ("", "")


def test_appended_arrays_of_polydata_without_a_place_are_refused(tmp_path, capfd):
    """VTK would take anything for their sizes."""
    pyvista = pytest.importorskip("pyvista")
    writer = pytest.importorskip("vtkmodules.vtkIOXML").vtkXMLPolyDataWriter()
    writer.SetFileName(str(tmp_path / "a.vtp"))
    writer.SetInputData(surface(pyvista))
    writer.SetDataModeToAppended()
    writer.Write()
    data = (tmp_path / "a.vtp").read_bytes()
    damaged = [re.sub(rb"(<AppendedData[^>]*>)\s*_", rb"\1", data)]
    damaged += [
        re.sub(rb'offset="\d+"', b'offset="' + other + b'"', data) for other in (b"1e30", b"-1", b"", b"9" * 5000)
    ]
    for one in damaged:
        with pytest.raises(io.ReadError, match="an array has no place in the appended data of this vtp file"):
            read(one, "vtp")
    assert capfd.readouterr() == ("", "")


def test_arrays_of_polydata_with_too_many_components_are_refused(tmp_path, capfd):
    """VTK would end the process for want of memory."""
    pyvista = pytest.importorskip("pyvista")
    surface(pyvista).save(tmp_path / "a.vtp")
    data = re.sub(rb'NumberOfComponents="3"', b'NumberOfComponents="2147483647"', (tmp_path / "a.vtp").read_bytes())
    with pytest.raises(io.ReadError, match="the arrays of this file need"):
        read(data, "vtp")
    assert capfd.readouterr() == ("", "")


def test_arrays_of_polydata_whose_sizes_are_not_in_base64_are_refused(tmp_path, capfd):
    """VTK decodes misplaced padding too, to other sizes than those that were checked."""
    pyvista = pytest.importorskip("pyvista")
    surface(pyvista).save(tmp_path / "a.vtp")
    data = (tmp_path / "a.vtp").read_bytes()
    start = re.search(rb'<DataArray[^>]*format="binary"[^>]*>\s*', data).end()
    for damage in (b"==", b"A=", b"#"):
        with pytest.raises(io.ReadError, match="an array of this vtp file is not in base64"):
            read(data[:start] + damage + data[start + len(damage) :], "vtp")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("count", ["-1", "x", "1e9", "", "9" * 400])
def test_counts_of_polydata_that_are_no_numbers_are_refused(tmp_path, capfd, count):
    """VTK would write beyond its memory for a negative number."""
    pyvista = pytest.importorskip("pyvista")
    surface(pyvista).save(tmp_path / "a.vtp", binary=False)
    data = re.sub(rb'NumberOfLines="\d+"', f'NumberOfLines="{count}"'.encode(), (tmp_path / "a.vtp").read_bytes())
    with pytest.raises(io.ReadError, match=f'NumberOfLines="{count[:20]}" in this vtp file is no count|the points and'):
        read(data, "vtp")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("version", ["42", "51"])
def test_cells_of_legacy_polydata_that_do_not_fit_together_are_refused(binary, version, tmp_path, capfd):
    """VTK would follow any number as if it were a count."""
    pyvista = pytest.importorskip("pyvista")
    vtk = pytest.importorskip("vtkmodules.vtkIOLegacy")
    writer = vtk.vtkPolyDataWriter()
    writer.SetFileName(str(tmp_path / "a.vtk"))
    writer.SetInputData(surface(pyvista))
    writer.SetFileVersion(int(version))
    writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
    writer.Write()
    data = (tmp_path / "a.vtk").read_bytes()
    assert len(read(data, "vtk").positions) == len(SHEET.vertices)
    other = (
        data.replace(b"Version 4.2", b"Version 5.1")
        if version == "42"
        else data.replace(b"Version 5.1", b"Version 3.0")
    )
    assert other != data
    with pytest.raises(io.ReadError, match="the cells of this vtk file are not those of version"):
        read(other, "vtk")
    for wrong in (
        data.replace(b"Version ", b"Version -"),
        re.sub(rb"(Version \d\.)\d", rb"\g<1>18446744073709551615", data),
    ):
        with pytest.raises(io.ReadError, match="does not begin with its version"):
            read(wrong, "vtk")
    if version == "42":
        start = re.search(rb"POLYGONS \d+ \d+\n", data).end()
        other = data[:start] + ((1 << 30).to_bytes(4, "big") if binary else b"9") + data[start + (4 if binary else 1) :]
        with pytest.raises(io.ReadError, match="do not fit together"):
            read(other, "vtk")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("line", ["POINTS", "POLYGONS", "FIELD FieldData", "Normals 3"])
def test_legacy_polydata_that_declares_more_than_it_holds_is_refused(line, tmp_path, capfd):
    pyvista = pytest.importorskip("pyvista")
    surface(pyvista).save(tmp_path / "a.vtk", binary=False)
    data = (tmp_path / "a.vtk").read_bytes()
    changed, count = re.subn(rb"\n(" + line.encode() + rb") (\d+)", rb"\n\1 \g<2>0000000000", data)
    assert count
    with pytest.raises(io.ReadError, match="of this vtk file declares more than it holds"):
        read(changed, "vtk")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("binary", [True, False])
def test_legacy_polydata_that_is_cut_within_the_line_of_a_field_is_refused(binary, tmp_path, capfd):
    """VTK would end the process."""
    pyvista = pytest.importorskip("pyvista")
    surface(pyvista).save(tmp_path / "a.vtk", binary=binary)
    data = (tmp_path / "a.vtk").read_bytes().replace(b"\nvtk output\n", b"\nfield\n")  # a title is no field
    assert b"\nfield\n" in data and len(read(data, "vtk").positions) == len(SHEET.vertices)
    start = data.rindex(b"FIELD FieldData")
    for length in range(len(b"FIELD"), len(b"FIELD FieldData ")):
        with pytest.raises(io.ReadError, match="a line FIELD of this vtk file has no count"):
            read(data[: start + length], "vtk")
    assert capfd.readouterr() == ("", "")
