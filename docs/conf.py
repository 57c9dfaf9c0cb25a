"""Configuration of the documentation: Sphinx, MyST Markdown, the theme Furo. `make docs` builds it."""

import sys
from pathlib import Path

import numpydoc.xref

import aoprecalc

sys.path.insert(0, str(Path(__file__).parent))  # for extensions/

project = "aoprecalc"
author = "The aoprecalc authors"
copyright = author
version = release = aoprecalc.__version__

extensions = [
    "extensions.commands",
    "extensions.mathml",
    "extensions.names",
    "extensions.schemas",
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_build", "extensions", "pictures"]
nitpicky = True
smartquotes = False  # leaves --size as it is

# Markdown
myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4  # a link such as page.md#a-heading works

# Docstrings
autodoc_typehints = "none"  # the NumPy sections have the types
autodoc_member_order = "bysource"
default_role = "name"
numpydoc_show_class_members = False
numpydoc.xref.DEFAULT_LINKS.clear()  # they lead to other sites
numpydoc_xref_param_type = True  # types are links, if they are public names
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = {name: f"aoprecalc.{name}" for name in aoprecalc.__all__}

# Pages
html_theme = "furo"
html_title = f"aoprecalc {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"source_view_link": "https://github.com/aoprecalc/aoprecalc/blob/main/docs/{filename}"}
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = False

# External links, checked by `make docs-linkcheck`
linkcheck_timeout = 20
linkcheck_retries = 2
linkcheck_anchors = False
linkcheck_ignore = [r"http://localhost"]
