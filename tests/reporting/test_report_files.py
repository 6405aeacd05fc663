"""Reports as files that an office hands in: XLSX, PDF and HTML."""

import datetime
import io
import re
import sys
import zipfile

import numpy as np
import pytest
from golden_files import assert_golden
from matplotlib.figure import Figure

import jaxcable as jc
from jaxcable.reporting import Report, Table
from jaxcable.reporting.document import Heading, make_document
from jaxcable.reporting.typesetting import _document_data
from jaxcable.reporting.web_page import page_text

ODD = "=1+1 <b> & #let $x$ @a *b* _c_ `d` \\e [f]"
VALUES = [0.1 + 0.2, -1.2345678901234567e-9, 12345678.912345679, 1e300, 2.0**-1074, None]
LONG = "a table with a very long name: of anchors / of ties [both]"


def odd_report():
    rows = [[ODD, k, value, -5.0] for k, value in enumerate(VALUES)]
    columns, units = ("group", "element", "force", "u"), ("", "", "N", "m")
    tables = {
        LONG: Table(f"Forces {ODD}", columns, units, rows, (f"note {ODD}",)),
        LONG.upper(): Table("Nothing", ("node",), ("",), []),
        LONG + "2": Table("Words", ("a", "b"), ("", ""), [["+2", "@x"], ["-3", "\t4"]]),
    }
    return Report(0, (f"status {ODD}",), tables)


def saved(report, path, **options):
    assert report.save(path, **options) == [path]
    return path.read_bytes()


def test_a_workbook_has_all_digits_and_no_formula(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    report, path = odd_report(), tmp_path / "r.xlsx"
    first = saved(report, path, title=ODD, author="=A", date=datetime.date(2026, 11, 27))
    book = openpyxl.load_workbook(path)
    assert len(book.sheetnames) == len({name.lower() for name in book.sheetnames}) == 4
    assert all(len(name) <= 31 for name in book.sheetnames)
    assert all(cell.data_type != "f" for sheet in book for row in sheet for cell in row)
    sheet = book.worksheets[1]
    found = [[cell.value for cell in row] for row in sheet.iter_rows(min_row=4, max_row=9)]
    assert found == report.tables[LONG].rows  # numbers to the last bit
    assert all(isinstance(row[2], float) for row in found[:-1])
    assert [cell.value for cell in sheet[2]] == ["group", "element", "force", "u"]
    assert [cell.value for cell in sheet[3]] == [None, None, "N", "m"]
    assert sheet.freeze_panes == "C4" and sheet.auto_filter.ref == "A3:D9"
    assert sheet["A11"].value == f"note {ODD}" and sheet["A1"].value == f"Forces {ODD}"
    assert sheet["D4"].number_format == "0.00000"
    words = [[cell.value for cell in row] for row in book.worksheets[3].iter_rows(4, 5)]
    assert words == [["+2", "@x"], ["-3", "\t4"]]
    assert book.properties.creator == "=A" and book.properties.created.year == 2026
    again = saved(report, path, title=ODD, author="=A", date=datetime.date(2026, 11, 27))
    assert first == again
    assert saved(report, path) == saved(report, path)  # without a date, too
    with zipfile.ZipFile(io.BytesIO(first)) as archive:
        texts = b"".join(archive.read(name) for name in archive.namelist())
    assert b"<f>" not in texts and b"http://" + b"example" not in texts


def picture():
    figure = Figure()
    figure.add_subplot().plot([0.0, 1.0])
    return figure


def test_a_page_escapes_texts_and_asks_nobody(tmp_path):
    """The file in `golden` is read by eye: no text is a tag, no place is of another host."""
    path = tmp_path / "r.html"
    options = {"title": ODD, "author": "A & B", "date": "27 November 2026"}
    text = saved(odd_report(), path, pictures={"<b>line</b>": picture()}, **options).decode()
    places = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert places and all(place.startswith(("#", "data:image/svg+xml")) for place in places)
    assert not re.findall(r"<(b|script|link|iframe)\b", text) and "url(" not in text
    body = re.sub(r"base64,[^\"]*|jaxcable [\w.]+, jax [\w.]+", "...", text.split("<body>")[1])
    assert_golden("odd_texts.html", body)
    again = saved(odd_report(), path, pictures={"<b>line</b>": picture()}, **options)
    assert again.decode() == text
    assert str(datetime.date.today().year) not in saved(odd_report(), path).decode()


def test_a_pdf_has_pages_a_title_and_no_date(tmp_path):
    pytest.importorskip("typst")
    path = tmp_path / "r.pdf"
    first = saved(odd_report(), path, title=ODD, author="A", pictures={ODD: picture()})
    assert first.startswith(b"%PDF-1.") and b"CreationDate" not in first
    assert len(re.findall(rb"/Type\s*/Page\b", first)) >= 2
    assert saved(odd_report(), path, title=ODD, author="A", pictures={ODD: picture()}) == first


@pytest.mark.parametrize("gap", [" ", "_"])
def test_names_of_200_characters_stay_in_their_columns(gap):
    name = gap.join(["cables of the northern hall".replace(" ", gap)] * 8)[:200]
    table = Table("Forces", ("group", "F"), ("", "N"), [[name, 1.0], ["ties", 2.0]])
    report = Report(0, ("status 0",), {"forces": table})
    lines = report.text().splitlines()
    assert max(map(len, lines)) <= 75  # 60 characters of a cell, and numbers beside it
    shown = re.sub(r"\s|1\.000", "", report.text())
    assert name.replace(" ", "") in shown  # all of it
    first, second = (next(k for k, line in enumerate(lines) if n in line) for n in ("1.0", "2.0"))
    assert second - first == 4 and "ties" in lines[second]  # the name goes on in lines between
    document = make_document([name], {"forces": table}, None, Heading(), {}, 10**9)
    data = _document_data(document)
    (cells,) = (part["cells"] for run in data["runs"] for t in run["tables"] for part in t["parts"])
    for text in (cells[0], *data["summary"]):
        assert max(map(len, re.split(r"[\s\u200b]", text))) <= 20
        assert text.replace("\u200b", "") == name


def test_wide_tables_are_turned_and_then_split():
    def table_of(count, n_row=20):
        names = ("group", "element", *(f"force {k}" for k in range(count)))
        rows = [["ties", 3, *np.linspace(-1e6, 1e6, count).tolist()]] * n_row
        table = Table("Wide", names, ("", "", *["N"] * count), rows)
        return make_document([], {"wide": table}, None, Heading(), {}, 1000).tables[0]

    narrow, turned, split = table_of(5), table_of(13), table_of(50)
    assert not narrow.landscape and turned.landscape and len(split.parts) > 2
    assert len(narrow.parts) == len(turned.parts) == 1
    for part in split.parts:
        assert part.headings[:2] == ["group", "element"] and part.rows[0][:2] == ["ties", "3"]
    shown = [name for part in split.parts for name in part.headings[2:]]
    assert shown == [f"force {k}" for k in range(50)]
    one_row = table_of(13, 1)  # has no page of its own
    first, second = one_row.parts
    assert [*first.headings[2:], *second.headings[2:]] == shown[:13] and not one_row.landscape
    (part,) = narrow.parts
    assert part.is_numeric == [False] + [True] * 6 and part.units[2:] == ["kN"] * 5
    assert part.rows[0][2] == "\N{MINUS SIGN}1000.000"


@pytest.mark.parametrize(("inches", "pages"), [((4.8, 3.0), 1), ((6.4, 3.0), 2), ((4.8, 30.0), 2)])
def test_narrow_pictures_are_beside_each_other(inches, pages, tmp_path):
    """Four of 4.8 inches on a page; four of 6.4 on two; high ones have 300 points, two a page."""
    pytest.importorskip("typst")
    figures = {f"{k}": Figure(figsize=inches) for k in range(4)}
    page = saved(Report(0, ("status 0",), {}), tmp_path / "r.pdf", pictures=figures)
    assert len(re.findall(rb"/Type\s*/Page\b", page)) == pages


def test_rows_that_are_left_out_are_said():
    table = Table("Long", ("node", "F"), ("", "N"), [[k, float(k)] for k in range(40)], (), 1)
    document = make_document([], {"long": table}, None, Heading(), {}, 7)
    assert [row[0] for row in document.tables[0].parts[0].rows] == [*map(str, range(39, 32, -1))]
    assert document.tables[0].notes == ["the largest 7 of 40 rows; files have all rows"]
    assert document.facts[0][0] == "program" and "the largest 7" in page_text(document)


@pytest.mark.parametrize("suffix, library", [("xlsx", "xlsxwriter"), ("pdf", "typst")])
def test_a_missing_library_is_named(suffix, library, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)  # its import fails
    with pytest.raises(ValueError, match=rf"needs {library}; pip install 'jaxcable\[reports\]'"):
        odd_report().save(tmp_path / f"r.{suffix}")
    assert not list(tmp_path.iterdir())


def test_what_is_no_picture_is_refused(tmp_path):
    for options, message in (
        ({"pictures": {"plan": "plan.png"}}, r"pictures\['plan'\]: expected a matplotlib Figure"),
        ({"rows": 0}, "rows"),
    ):
        with pytest.raises(ValueError, match=message):
            odd_report().save(tmp_path / "r.html", **options)
    assert not list(tmp_path.iterdir())


def test_a_report_of_an_analysis_becomes_all_files(tmp_path):
    structure, phases = jc.scenes.flat_net(load=15.0, increments=(1, 1))
    report = jc.report(structure, jc.solve(structure, phases), units="kip, ft")
    page = saved(report, tmp_path / "r.html").decode()
    assert "kip, ft" in page and all(table.title in page for table in report.tables.values())
    openpyxl = pytest.importorskip("openpyxl")
    saved(report, tmp_path / "r.xlsx")
    book = openpyxl.load_workbook(tmp_path / "r.xlsx")
    for name, table in report.tables.items():
        rows = book[name].iter_rows(4, 3 + len(table.rows), 1, len(table.columns))
        expected = [[None if value == "" else value for value in row] for row in table.rows]
        assert [[cell.value for cell in row] for row in rows] == expected
