"""A page shows names as text and loads nothing from elsewhere."""

import re

from report_contents import ROUGH

import cascadenorm as cn
from cascadenorm.io.interop import save_mesh


def test_names_are_escaped_and_a_report_asks_nothing_of_the_network(place):
    save_mesh(place / "a<b>&'c.ply", ROUGH)
    cn.report("r.html", "a<b>&'c.ply")
    page = (place / "r.html").read_text()
    assert "a&lt;b&gt;&amp;&#x27;c.ply" in page and "<b>" not in page
    assert "default-src 'none'" in page
    outside = re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.S)
    assert re.findall(r"""(?:src|href)=["'](?!data:)""", outside) == []
