"""Settings of the site: `make site` builds it without network, and warnings are errors."""

import sys
from pathlib import Path

import jaxcable

sys.path.insert(0, str(Path(__file__).parent))  # mathml.py
project = "jaxcable"
author = "The jaxcable developers"
copyright = "2026, the jaxcable developers"
version = release = jaxcable.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "myst_nb",
    "sphinx_copybutton",
    "mathml",
]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}
exclude_patterns = ["parts", "extra"]  # included in pages, or copied as they are
html_theme = "furo"
html_math_renderer = "mathml"
html_title = f"jaxcable {release}"
html_favicon = "_static/favicon.svg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_extra_path = ["extra"]
html_theme_options = {"top_of_page_buttons": []}

# notebooks are written, with their outputs, by `make notebooks`, and tested by `make test-more`
nb_execution_mode = "off"
nb_merge_streams = True
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_custom_sections = [("Options", "params_style")]
napoleon_use_rtype = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # shapes such as "*shape" are no markup
default_role = "code"
copybutton_prompt_text = ">>> "


def _write_index_for_models(app, error):
    """Write llms.txt: the titles of all pages, with their addresses (https://llmstxt.org)."""
    if error is not None:
        return
    titles = app.env.titles
    lines = [f"# {project}", "", f"> {_summary()}", ""]
    for name in sorted(app.env.found_docs, key=lambda name: (name.count("/"), name)):
        if name in titles:
            lines.append(f"- [{titles[name].astext()}]({name}.html)")
    text = "\n".join(lines) + "\n"
    (Path(app.outdir) / "llms.txt").write_text(text, encoding="utf-8")


def _summary():
    return (jaxcable.__doc__ or "").splitlines()[0]


def setup(app):
    """Connect what is written at the end."""
    app.connect("build-finished", _write_index_for_models)
