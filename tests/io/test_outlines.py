"""Outlines from whatever a user has of one."""

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from ezdxf.filemanagement import new
from ezdxf.math import closed_uniform_bspline

from palpate import Disc, FileError, Polygon, Rectangle, SettingError, load_shape

BOX = [(0.0, 0.0), (0.09, 0.0), (0.09, 0.06), (0.0, 0.06)]
ELL = np.array([(0, 0), (90, 0), (90, 30), (40, 30), (40, 60), (0, 60)])


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def extent_of(shape):
    return float(np.ptp(shape.outline(), axis=0).max())


def apart(shape, corners):
    """How much of the two areas is not shared, as a share of one of them."""
    found, wanted = shapely.Polygon(shape.corners), shapely.Polygon(corners)
    return found.symmetric_difference(wanted).area / wanted.area


def test_names_and_lengths():
    assert load_shape("disc") == load_shape("Disc") == Disc(0.088)
    assert load_shape("0.09x0.06") == load_shape("0.09X0.06") == Rectangle(0.09, 0.06)
    assert load_shape("90x60", unit="mm") == load_shape("90mmx60mm") == load_shape("9cmX6cm") == Rectangle(0.09, 0.06)
    assert load_shape("90 mm x 60 mm") == load_shape("0.09 x 0.06") == Rectangle(0.09, 0.06)
    with pytest.raises(SettingError, match="shape is ''; allowed are disc"):
        load_shape("")


@pytest.mark.parametrize(
    "text",
    [
        "0 0\n90 0\n90 60\n0 60\n",
        "x,y\n0,0\n90,0\n90,60\n0,60\n",
        "sep=;\n% mm # or so\n0;0\n90;0\n90;60\n0;60",
        "0,0 0\n9,0e1 0\n90 60,0\n0 60",
    ],
)
def test_tables(text):
    Path("box.csv").write_text(text)
    assert apart(load_shape("box.csv", unit="mm"), BOX) < 1e-12


def test_a_byte_order_mark_and_decimal_commas():
    mark = "\ufeff"
    Path("box.csv").write_text(mark + "x;y\n0;0\n0,09;0\n0,09;0,06\n0;0,06\n", encoding="utf-8")
    Path("tabs.txt").write_text("0\t0\n0,09\t0\n0,09\t0,06\n0\t0,06\n")
    Path("quoted.csv").write_text('"x","y"\n"0,00","0"\n"0,09","0"\n"0,09","0,06"\n"0","0,06"\n')
    Path("box.json").write_text(mark + json.dumps({"vertices": BOX}), encoding="utf-8")
    Path("turned.csv").write_text("Nr, Y [mm], X [mm]\n1, 0, 0\n2, 0, 90\n3, 60, 90\n4, 60, 0\n", encoding="utf-16")
    for name in ("box.csv", "tabs.txt", "quoted.csv", "box.json", "turned.csv"):
        assert apart(load_shape(name), BOX) < 1e-12


def test_json():
    Path("box.json").write_text(json.dumps({"vertices": BOX}))
    assert load_shape(Path("box.json")) == Polygon(BOX)
    Path("can.json").write_text('{"type": "disc", "radius": 33}')
    assert load_shape("can.json", unit="mm") == Disc(0.033)


def svg(content, page='width="100mm" height="50mm" viewBox="0 0 200 100"'):
    Path("a.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {page}>{content}</svg>')
    return "a.svg"


def test_svg_is_as_large_as_its_page_says_and_y_is_up():
    path = "M0 0 H180 V60 H80 V120 H0 Z"  # an L, its foot above, in half millimetres
    found = load_shape(svg(f'<g transform="translate(7 9)"><path d="{path}"/></g><text x="3" y="4">L</text>'))
    drawn = ELL * (1e-3, -1e-3)
    assert apart(found, drawn - Polygon(drawn).centroid) < 1e-5
    assert found.centroid == pytest.approx([0.0, 0.0], abs=1e-12)
    # A unit that is given counts for the numbers in the drawing, whatever its page says.
    assert extent_of(load_shape(svg(f'<path d="{path}"/>'), unit="mm")) == pytest.approx(0.18)


def test_svg_curves_and_holes(caplog):
    page = 'width="90" height="90" viewBox="-45 -45 90 90"'
    circle = svg('<circle r="40"/><circle r="5"/>', page)
    with pytest.raises(FileError, match=r"a.svg: the drawing has no size, its width is '90'.*--shape-unit"):
        load_shape(circle)
    found = load_shape(circle, unit="mm")
    assert found.signed_distance(Disc(0.04).outline(500)) == pytest.approx(0.0, abs=3e-5)
    assert "1 outlines within the largest are holes" in caplog.text
    assert len(found.outline(10)) < 150


def test_lines_that_meet_are_an_outline():
    parts = '<polyline points="0,0 90,0 90,60" fill="none" stroke="red"/><line x1="90" y1="60" x2="0" y2="0"/>'
    assert load_shape(svg(parts, 'width="90mm" height="60mm" viewBox="0 0 90 60"')).area == pytest.approx(
        0.09 * 0.03, rel=1e-3
    )


def drawing(unit, draw):
    made = new(units=unit)
    draw(made.modelspace())
    made.saveas("a.dxf")
    return "a.dxf"


def draw_l(space):
    for start, end in zip(ELL, np.roll(ELL, -1, axis=0), strict=True):
        space.add_line(start, end)
    space.add_text("a bracket")
    space.add_circle((20, 20), 5)


def test_dxf():
    found = load_shape(drawing(4, draw_l))
    assert apart(found, ELL * 1e-3) < 1e-6
    assert extent_of(load_shape(drawing(1, lambda space: space.add_circle((0, 0), 2)))) == pytest.approx(
        0.1016, rel=1e-3
    )
    for none in (0, 8):  # microinches
        with pytest.raises(FileError, match=r"has no unit that is known \(.INSUNITS is"):
            load_shape(drawing(none, draw_l))
    assert apart(load_shape("a.dxf", unit="mm"), ELL * 1e-3) < 1e-6
    rounded = [(0, 0, 0), (60, 0, 1.0), (60, 40, 0), (0, 40, 0)]  # a half circle at the right end
    drawing(4, lambda space: space.add_lwpolyline(rounded, format="xyb", close=True))
    assert load_shape("a.dxf").area == pytest.approx(1e-6 * (60 * 40 + np.pi * 20**2 / 2), rel=1e-3)


def test_a_drawing_is_read_as_it_is_seen():
    def draw(space, gap=0.0):
        document = space.doc
        document.layers.get("0").off()
        document.layers.add("parts")
        for name in ("off", "frozen"):
            layer = document.layers.add(name)
            (layer.off if name == "off" else layer.freeze)()
            space.add_lwpolyline([(-9, -9), (200, -9), (200, 200), (-9, 200)], close=True, dxfattribs={"layer": name})
        block = document.blocks.new("PART")
        for start, end in zip(ELL, np.roll(ELL, -1, axis=0), strict=True):
            block.add_line(start, end + np.array([gap, 0.0]))
        for _ in range(2):  # drawn twice
            space.add_blockref("PART", (5, 5), dxfattribs={"rotation": 90, "layer": "parts"})
        space.add_line((-20, 20), (120, 20), dxfattribs={"layer": "parts"})  # a centre line
        space.add_circle((300, 20), 5)

    wanted = 5e-3 + ELL @ np.array([[0.0, 1.0], [-1.0, 0.0]]) * 1e-3
    for gap in (0.0, 1e-4, 5e-3):
        assert apart(load_shape(drawing(4, lambda space, gap=gap: draw(space, gap))), wanted) < 1e-3
    with pytest.raises(
        FileError, match=r"no closed outline: lines end alone at \(-55.00, 5.00\), \(-55.00, 5.50\).* mm"
    ):
        load_shape(drawing(4, lambda space: draw(space, 0.5)))


CLIPS = (
    '<clipPath id="c"><rect width="40" height="90"/></clipPath>'
    '<clipPath id="d" transform="scale(0.5)"><use href="#r"/></clipPath>'
    '<clipPath id="e" clipPathUnits="objectBoundingBox"><rect x="0.25" width="0.5" height="0.5"/></clipPath>'
    '<defs><rect id="r" y="30" width="99" height="40"/></defs>'
)

NESTED = '<svg x="10" y="10" width="60" height="20" viewBox="0 0 6 2"><rect width="6" height="2"/></svg>'


@pytest.mark.parametrize(
    ("drawn", "extent"),
    [
        ('<g clip-path="url(#c)"><rect x="10" y="10" width="60" height="20"/></g>' + CLIPS, (30, 20)),
        ("<style>.k{clip-path: url(#c)}</style>" + CLIPS + '<rect class="k" width="60" height="20"/>', (40, 20)),
        (CLIPS + '<rect transform="translate(9 9)" width="60" height="20" clip-path="url(\'#c\')"/>', (40, 20)),
        (CLIPS + '<g clip-path="url(#c)"><rect clip-path="url(#d)" x="10" width="60" height="30"/></g>', (30, 15)),
        (CLIPS + '<g transform="rotate(90)" clip-path="url(#e)"><rect y="-70" width="60" height="40"/></g>', (20, 30)),
        (CLIPS + '<rect clip-path="url(#nothing)" width="60" height="20"/>', (60, 20)),
        (CLIPS + '<path clip-path="url(#d)" fill="none" stroke="red" d="M2 16H30V30H2Z"/>', (28, 14)),
        ('<rect width="100" height="50" fill="#fff" stroke="white"/><rect width="60" height="20"/>', (60, 20)),
        ('<path d="M10 10H70V30H10"/>', (60, 20)),  # filled, so seen as closed
        (NESTED + '<rect x="10" y="10" width="60" height="20"/>', (60, 20)),
    ],
)
def test_an_svg_is_read_as_it_is_seen(drawn, extent):
    found = load_shape(svg(drawn, 'width="100mm" height="50mm" viewBox="0 0 100 50"'))
    assert np.ptp(found.outline(), axis=0) * 1e3 == pytest.approx(extent, abs=0.01)


def test_drawings_that_are_packed_or_of_another_program(tmp_path):
    packed = tmp_path / "a.svgz"
    drawn = svg('<rect width="60" height="20"/>', 'width="60mm" viewBox="0 0 60 20"')
    packed.write_bytes(gzip.compress(Path(drawn).read_bytes()))
    assert extent_of(load_shape(packed)) == pytest.approx(0.06)
    (tmp_path / "part.STL").write_text("solid x y\n")
    with pytest.raises(FileError, match=r"part\.STL: is no outline; allowed are files named \.svg, .*\.dxf, .*\.csv"):
        load_shape(tmp_path / "part.STL")
    (tmp_path / "wide.txt").write_bytes("0\t0\n0.06\t0\n0.06\t0.04\n".encode("utf-16-le"))
    with pytest.raises(FileError, match=r"wide\.txt: is not a text file"):
        load_shape(tmp_path / "wide.txt")


END = "42.4264,42.4264"  # of the longer axis
CIRCLE = '<circle cx="50" cy="50" r="30" transform="skewX(45)"/>'


@pytest.mark.parametrize(
    ("drawn", "extent", "area"),
    [
        (CIRCLE, (60 * 2**0.5, 60), 900 * np.pi),
        ('<rect width="90" height="60" rx="20" transform="skewY(45)"/>', (90, 126.57), 5400 - 400 * (4 - np.pi)),
        ('<g transform="scale(1,2)"><ellipse rx="30" ry="10" transform="rotate(45)"/></g>', (44.7, 89.4), 600 * np.pi),
        (f'<path d="M0,0 A30,10 45 1 1 {END} A30,10 45 1 1 0,0" transform="scale(-1,2)"/>', (44.7, 89.4), 600 * np.pi),
        (
            f'<clipPath id="c">{CIRCLE}</clipPath><rect width="300" height="300" clip-path="url(#c)"/>',
            (84.9, 60),
            2827.4,
        ),
    ],
)
def test_curves_of_an_svg_that_are_sheared_or_stretched(drawn, extent, area):
    """An ellipse keeps its area under a shear; stretched about a turned axis it is another ellipse."""
    found = load_shape(svg(drawn, 'width="300mm" height="300mm" viewBox="0 0 300 300"'))
    assert 1e3 * np.ptp(found.outline(), axis=0) == pytest.approx(extent, abs=0.1)
    assert 1e6 * found.area == pytest.approx(area, rel=2e-3)


def test_hidden_parts_and_blanks_in_an_svg(caplog):
    hidden = (
        '<mask id="m"><rect width="90" height="50"/></mask><g visibility="hidden"><rect width="95" height="50"/></g>'
        '<rect width="96" height="50" opacity="0.00"/>'
        '<symbol id="s"><rect width="98" height="50"/></symbol><rect fill="none" width="99" height="50"/>'
        '<rect width="99" height="50" style="fill:transparent;stroke:red;stroke-width:0"/>'
    )
    part = '<rect x="10" y="10" width="60" height="30" mask="url(#m)"/>'
    for page in ('width="100 mm" height="5.0 cm"', 'width="100mm"', 'height="50mm"'):
        assert extent_of(load_shape(svg(hidden + part, f'{page} viewBox="0 0 100 50"'))) == pytest.approx(0.06)
    assert "mask" in caplog.text
    cut = 'width="200mm" height="50mm" viewBox="0 0 100 50" preserveAspectRatio="xMidYMid slice"'
    assert extent_of(load_shape(svg('<rect width="60" height="30"/>', cut))) == pytest.approx(0.12)
    assert extent_of(load_shape("70x9", unit="cm")) == pytest.approx(0.7)
    assert "70x9: the outline is 0.7 m wide, much for an object that a fingertip pushes" in caplog.text


SLOT = [(0, 0), (90, 0), (90, 60), (65, 60), (65, 20), (25, 20), (25, 60), (0, 60)]
"""A U of 3800 mm2 [mm]."""


def sheet(x, y, width=290, height=210):
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]


def draw_sides(space, corners, **attributes):
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        space.add_line(start, end, dxfattribs=attributes)


@pytest.mark.parametrize("is_polyline", [True, False])
@pytest.mark.parametrize("beside", ["centre line", "dimensions", "leader", "phantom", "layer", "image", "defpoints"])
def test_what_is_drawn_beside_a_part_is_no_side_of_it(beside, is_polyline, caplog):
    caplog.set_level("INFO")
    made = new(units=4, setup=True)
    space = made.modelspace()
    if is_polyline:
        space.add_lwpolyline(SLOT, close=True)
    else:
        draw_sides(space, SLOT)
    if beside == "centre line":  # of no line type of its own
        space.add_line((-10, 30), (100, 30))
        space.add_line((45, -10), (45, 70))
    elif beside == "dimensions":
        for start, end in (((0, 65), (90, 65)), ((0, 60), (0, 70)), ((90, 60), (90, 70))):
            space.add_line(start, end)
        space.add_solid([(0, 65), (3, 66), (3, 64)])
        space.add_linear_dim(base=(0, -10), p1=(0, 0), p2=(90, 0)).render()
    elif beside == "leader":
        space.add_lwpolyline([(90, 60), (100, 80), (120, 80)])
    elif beside == "phantom":
        space.add_lwpolyline(sheet(-99, -99), close=True, dxfattribs={"linetype": "PHANTOM"})
    elif beside == "layer":
        made.layers.add("AUX", linetype="DASHED")
        space.add_lwpolyline(sheet(-99, -99), close=True, dxfattribs={"layer": "AUX"})
    elif beside == "image":
        space.add_image(made.add_image_def("a.png", (640, 480)), (-20, -20), (200, 150))
    else:
        space.add_lwpolyline(sheet(-99, -99), close=True, dxfattribs={"layer": "Defpoints"})
    made.saveas("a.dxf")
    assert load_shape("a.dxf").area == pytest.approx(3800e-6)
    assert "a.dxf: outline 90 x 60 mm, layer 0, 8 corners" in caplog.text


def test_exploded_dimensions_are_no_sides():
    made = new(units=4, setup=True)
    space = made.modelspace()
    space.add_lwpolyline(SLOT, close=True)
    space.add_line((0, 75), (90, 75))
    space.add_lwpolyline([(0, 75), (3, 75.5), (3, 74.5)], close=True)
    space.add_line((10, 0), (10, 60))
    space.add_lwpolyline([(10, 0), (10.5, 3), (9.5, 3)], close=True)  # in the part
    dimension = space.add_linear_dim(base=(0, -10), p1=(0, 0), p2=(90, 0))
    dimension.render()
    dimension.dimension.explode()
    made.saveas("a.dxf")
    assert load_shape("a.dxf").area == pytest.approx(3800e-6)


def test_arrow_heads_of_all_kinds_are_no_outlines(caplog):
    made = new(units=4, setup=True)
    space = made.modelspace()
    space.add_lwpolyline(SLOT, close=True)
    for number, head in enumerate(["", "DOT", "DOTBLANK", "BOXBLANK", "DATUMBLANK"]):
        space.add_arrow(head, insert=(90, 10 * number + 2), size=3, rotation=180)  # at the part's side
        space.add_line((93, 10 * number + 2), (120, 10 * number + 2))
        base = (0, -10 - 8 * number)
        dimension = space.add_linear_dim(base=base, p1=(0, 0), p2=(90, 0), override={"dimblk": head, "dimasz": 3})
        dimension.render()
        dimension.dimension.explode()
    for block in space.query("INSERT"):
        block.explode()  # pyright: ignore[reportAttributeAccessIssue]
    made.saveas("a.dxf")
    assert load_shape("a.dxf").area == pytest.approx(3800e-6)
    assert "taken as arrow heads" in caplog.text

    def pointed_at(space):  # a small part in the frame of a sheet
        space.add_lwpolyline(sheet(0, 0, 297), close=True)
        space.add_lwpolyline([(50, 50), (70, 50), (60, 68)], close=True)
        space.add_line((60, 68), (90, 120))

    with pytest.raises(FileError, match="may be a frame around 20 x 18 mm"):
        load_shape(drawing(4, pointed_at))


def test_a_body_beside_lines_is_asked_about():
    def solid(space):
        space.add_3dface([(0, 0, 0), (90, 0, 0), (90, 60, 0), (0, 60, 0)], dxfattribs={"layer": "PART"})

    with pytest.raises(FileError, match=r"no closed outline: .*3DFACE cannot be read: explode it to lines"):
        load_shape(drawing(4, solid))
    with pytest.raises(FileError, match=r"no line on layer 'PART'.*3DFACE cannot be read"):
        load_shape("a.dxf", layer="PART")

    def in_a_frame(space):
        solid(space)
        space.add_lwpolyline(sheet(-100, -80), close=True)

    with pytest.raises(FileError, match=r"beside the outline of 290 x 210 mm.* 3DFACE cannot be read"):
        load_shape(drawing(4, in_a_frame))
    assert load_shape("a.dxf", layer="0").area == pytest.approx(0.29 * 0.21)


def test_a_frame_round_a_part_is_asked_about():
    def draw(space, is_named=True, holes=1, text="", side=290):
        named = {"layer": "PART" if is_named else "0"}
        space.add_lwpolyline(sheet(-40, -40, side), close=True)
        space.add_lwpolyline(SLOT, close=True, dxfattribs=named)
        for _ in range(holes):
            space.add_circle((10, 10), 4, dxfattribs=named)
        if text:
            space.add_text(text).set_placement((100, -30))

    several: Any = ({}, {"is_named": False}, {"holes": 0}, {"holes": 0, "is_named": False})
    for options in several:
        with pytest.raises(FileError, match=r"290 x 210 mm.* 90 x 60 mm.*shape_layer"):
            load_shape(drawing(4, lambda space, options=options: draw(space, **options)))
    with pytest.raises(FileError, match=r"may be a frame"):
        load_shape(drawing(4, lambda space: draw(space, False, 0, "bracket", side=160)))
    assert load_shape(drawing(4, draw), layer="part").area == pytest.approx(3800e-6)
    with pytest.raises(FileError, match=r"no line on layer 'parts'; it shows lines on 0, PART"):
        load_shape("a.dxf", layer="parts")
    with pytest.raises(SettingError, match="no drawing"):
        load_shape("a.csv", layer="part")

    def draw_plate(space):  # of which the inner outlines are holes
        space.add_lwpolyline(sheet(0, 0, 160, 100), close=True)
        space.add_lwpolyline(sheet(60, 40, 30, 20), close=True)
        for x in (10, 150):
            space.add_circle((x, 10), 3)

    assert load_shape(drawing(4, draw_plate)).area == pytest.approx(0.016)


def test_closed_lines_are_one_outline_or_it_is_said(caplog):
    def divided(space):
        draw_sides(space, SLOT)
        space.add_line((25, 20), (0, 0))
        space.add_line((25, 20), (90, 0))

    assert load_shape(drawing(4, divided)).area == pytest.approx(3800e-6)
    assert "lines divide the outline into 3 areas" in caplog.text

    def crossing(space):
        space.add_lwpolyline(SLOT, close=True)
        space.add_circle((90, 20), 20)

    with pytest.raises(FileError, match="closed lines cross"):
        load_shape(drawing(4, crossing))
    alike = '<path d="M0 0H90V60H0Z" fill="#888"/><path d="M50 0H100V80H50Z" fill="#888"/>'
    page = 'width="100mm" viewBox="0 0 100 100"'
    assert load_shape(svg(alike, page)).area == pytest.approx(7e-3)
    with pytest.raises(FileError, match="dashed"):
        load_shape(svg('<rect fill="none" stroke="red" stroke-dasharray="4 2" width="60" height="40"/>', page))


def test_layers_of_an_svg():
    points = " ".join(f"{x + 20},{100 - y}" for x, y in SLOT)
    content = (
        '<g inkscape:label="Sheet" id="g1"><rect x="5" y="5" width="200" height="140" fill="none" stroke="red"/></g>'
        f'<g inkscape:label="Part" id="g2"><g id="g3"><polygon points="{points}" fill="none" stroke="red"/></g></g>'
    )
    page = (
        'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" width="210mm" height="150mm" '
        'viewBox="0 0 210 150"'
    )
    with pytest.raises(FileError, match=r"200 x 140 mm on layer Sheet may be a frame around 90 x 60 mm on layer Part"):
        load_shape(svg(content, page))
    for layer in ("Part", "g2", "g3"):
        assert load_shape("a.svg", layer=layer).area == pytest.approx(3800e-6)


def test_an_outline_out_of_the_plane_is_refused():
    def draw(space, turned):
        space.add_polyline3d([turned(x, y) for x, y in SLOT], close=True)

    with pytest.raises(FileError, match="tilted plane"):
        load_shape(drawing(4, lambda space: draw(space, lambda x, y: (x, 0.866 * y, 0.5 * y))))
    with pytest.raises(FileError, match="not lie flat"):
        load_shape(drawing(4, lambda space: draw(space, lambda x, y: (x, 0.0, y))))
    assert load_shape(drawing(4, lambda space: draw(space, lambda x, y: (x, y, 7.0)))).area == pytest.approx(3800e-6)


def test_a_periodic_spline_ends_where_it_began(caplog):
    curve = closed_uniform_bspline([(100, 100), (160, 100), (160, 140), (100, 140)])
    found = load_shape(drawing(4, lambda space: space.add_spline().apply_construction_tool(curve)))
    # At a knot it is (1, 4, 1) / 6 of three corners, between two of them (1, 23, 23, 1) / 48 of four.
    np.testing.assert_allclose(np.ptp(found.outline(), axis=0), [0.06 * 22 / 24, 0.04 * 22 / 24], atol=2e-5)
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


def test_a_noisy_scan_is_warned_of(caplog):
    angle = np.arange(600) / 600 * 2 * np.pi
    radius = 0.05 + np.random.default_rng(0).normal(scale=1e-4, size=600)
    np.savetxt("scan.csv", radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), delimiter=",")
    load_shape("scan.csv")
    assert "corners; smooth it if it is a scan" in caplog.text


def test_loops_that_a_blank_line_parts_are_told(caplog):
    Path("a.txt").write_text("0 0\n.09 0\n.09 .06\n0 .06\n\n.02 .04\n.04 .04\n.04 .02\n.02 .02\n")
    load_shape("a.txt")
    assert "line 6 follows a blank line or a remark; all corners are taken as one outline" in caplog.text


@pytest.mark.parametrize("name", ["butterfly", "rounded-square"])
def test_corners_that_are_exact_stay_as_they_are(name):
    shape = load_shape(name)
    assert isinstance(shape, Polygon)
    np.savetxt("exact.txt", shape.corners)
    assert np.allclose(load_shape("exact.txt").corners, shape.corners)  # pyright: ignore[reportAttributeAccessIssue]


def test_of_many_corners_those_that_a_curve_needs_are_kept(tmp_path):
    angle = np.arange(3000) / 3000 * 2 * np.pi
    corners = 0.05 * np.column_stack([np.cos(angle), np.sin(angle)])
    np.savetxt(tmp_path / "disc.csv", corners, delimiter=",")
    (tmp_path / "disc.json").write_text(json.dumps({"vertices": corners.tolist()}))
    for name in ("disc.csv", "disc.json"):
        found = load_shape(tmp_path / name)
        assert isinstance(found, Polygon) and 50 < len(found.vertices) <= 256
        assert np.abs(found.signed_distance(corners)).max() <= 2e-5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0 0\n90 0\n90 60\n0 60\n", r"is 90 m wide, .* millimetres or centimetres\? unit= .--shape-unit"),
        ("0 0\n3.5 0\n3.5 2\n0 2\n", r"is 3.5 m wide.* are these centimetres or inches\?"),
        ("0 0\n2e5 0\n2e5 2\n", "is 200000 m wide, allowed are 0.005 to 2 m$"),
        ("0 0 0\n1 0 0\n", "is no table of numbers x y: line 1 is '0,0,0'"),
        ("0,0\n90,\n90,25\n", "is no table of numbers x y: line 2 is '90,'"),
        ("0 0\n1 a\n", "is no table of numbers x y: line 2 is '1,a'"),
        ("x y\n", "is no table of numbers x y: it holds none"),
        ("x_mm,y_cm\n0,0\n", "has the columns x_mm, y_cm; expected x and y, or x_mm and y_mm, in one unit"),
        ("u,v\n0,0\n", "has the columns u, v; expected x and y"),
        ("x,y,x,y\n0,0,0,0\n", "has the columns x, y, x, y; expected x and y"),
        ("0 0\n.1 .1\n.1 0\n0 .1\n", "crosses or touches itself"),
    ],
)
def test_tables_that_are_no_outline(text, words):
    Path("bad.csv").write_text(text)
    with pytest.raises(FileError, match=f"bad.csv: .*{words}"):
        load_shape("bad.csv")


def test_what_is_no_outline_is_said():
    with pytest.raises(SettingError, match=r"shape is 'brick'; allowed are disc, .* 0.09x0.06"):
        load_shape("brick")
    for gone in ("gone.svg", "./gone", "/tmp/none.csv"):
        with pytest.raises(FileError, match=f"^{Path(gone)}: no such file"):
            load_shape(gone)
    Path("outlines").mkdir()
    with pytest.raises(FileError, match="outlines: is a folder"):
        load_shape("outlines")
    with pytest.raises(SettingError, match="unit is 'furlong'; allowed are mm, cm, in, m"):
        load_shape("disc", unit="furlong")  # pyright: ignore[reportArgumentType]
    with pytest.raises(SettingError, match="disc is an object of a known size"):
        load_shape("disc", unit="mm")
    with pytest.raises(FileError, match="are these millimetres"):
        load_shape("90x60")
    page = 'width="100mm" height="100mm"'
    for content, words in (
        ('<rect width="90" height="60"/><rect x="200" width="90" height="60"/>', "2 outlines side by side"),
        ('<polyline points="0,0 90,0 90,60" fill="none" stroke="red"/>', "holds no closed outline"),
        ("<text>nothing</text>", "holds no closed outline"),
        ("<rect", "a.svg: is no SVG that can be read"),
    ):
        with pytest.raises(FileError, match=words):
            load_shape(svg(content, page))
    with pytest.raises(FileError, match="stretched to its page"):
        load_shape(svg('<rect width="9" height="6"/>', f'{page} viewBox="0 0 9 6" preserveAspectRatio="none"'))
    symbol = '<symbol id="s" viewBox="0 0 200 200"><rect width="90" height="60"/></symbol><use href="#s" width="50"/>'
    with pytest.raises(FileError, match="a symbol has a viewBox"):
        load_shape(svg(symbol, page))
    with pytest.raises(FileError, match="lines enclose no area"):
        load_shape(drawing(4, lambda space: space.add_circle((0, 0), 1e-4)))
    Path("bad.dxf").write_text("no drawing")
    with pytest.raises(FileError, match=r"bad.dxf: is no DXF that can be read"):
        load_shape("bad.dxf")


@pytest.mark.parametrize("rule", [".a {display: none}", "rect.a{display:none}", "*{stroke-width:1} rect{display:none}"])
def test_a_style_sheet_hides_what_is_drawn_before_and_after_it(rule):
    page = 'width="100mm" viewBox="0 0 100 100"'
    frame = '<rect class="a" width="95" height="95"/>'
    for content in (f"<style>{rule}</style>{frame}", f"{frame}<style>/* g &gt; .a */ {rule}</style>"):
        part = '<path d="M10 10h60v30h-60z"/>'
        assert extent_of(load_shape(svg(content + part, page))) == pytest.approx(0.06)


@pytest.mark.parametrize(
    "rule", ["g .a{display:none}", "@media print{rect{fill:none}}", "rect:nth-child(1) {opacity:0}"]
)
def test_a_style_sheet_that_is_not_understood_is_refused_where_it_matters(rule):
    page = 'width="100mm" viewBox="0 0 100 100"'
    with pytest.raises(FileError, match="style sheet"):
        load_shape(svg(f'<style>{rule}</style><rect class="a" width="60" height="30"/>', page))
    for harmless in ("g .a{font-size:3px}", ".a:hover{fill:none}"):
        assert load_shape(svg(f'<style>{harmless}</style><rect class="a" width="60" height="30"/>', page))


def test_what_would_make_an_outline_of_another_file_is_said():
    for name, hint in (("part.step", "DXF"), ("mask.png", "trace"), ("part.dwg", "save it")):
        Path(name).write_bytes(b"any")
        with pytest.raises(FileError, match=hint):
            load_shape(name)
    corners = [(0, 0), (60, 40), (60, 0), (0, 40)]
    with pytest.raises(FileError, match="crosses itself"):
        load_shape(drawing(4, lambda space: space.add_lwpolyline(corners, close=True)))


def test_without_the_libraries_for_drawings(monkeypatch):
    monkeypatch.setattr("palpate.io.outlines.find_spec", lambda _: None)
    svg("<rect/>")
    with pytest.raises(FileError, match=r"svgelements, which is not installed: .*\[outlines\]"):
        load_shape("a.svg")
