# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of Sphinx: ``make docs`` and rosdoc2 build the site from the pages in this folder."""

from importlib.util import find_spec, module_from_spec, spec_from_file_location
import os
from pathlib import Path
from pydoc import locate
import re
from xml.etree import ElementTree

# rosdoc2 runs this text in another folder, with a copy of the pages.
ROOT = Path(find_spec('tp_controller').origin).parents[1]
# Files beside the folder that are pages of the site.
INCLUDED = {'README.md': 'index.md', 'CONTRIBUTING.md': 'contributing.md',
            'CHANGELOG.rst': 'changelog.md', 'RELEASING.md': 'versions.md',
            'QUALITY_DECLARATION.md': 'quality_declaration.md'}
# Those of them that take the place of a page as a whole.
WHOLE = {'contributing': 'CONTRIBUTING.md', 'versions': 'RELEASING.md',
         'quality_declaration': 'QUALITY_DECLARATION.md'}
# Links of a file beside the folder to another one.
BESIDE = re.compile(r'\]\((?!#|docs/|\w+://)')
OUTSIDE = re.compile(r'(?P<before>\]\(|include:: )(?P<path>(?:\.\./)+[^)\s#]+)')

project = 'tp_controller'
author = project_copyright = 'tp_controller contributors'
version = ElementTree.parse(ROOT / 'package.xml').findtext('version')

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon']
# rosdoc2 adds pages that are not ours: these, and all in reStructuredText.
source_suffix = {'.md': 'markdown'}
exclude_patterns = ['_build', 'README.md', *WHOLE.values()]
highlight_language = 'text'
html_theme = 'furo'
html_title = f'{project} {version}'
html_copy_source = False
if find_spec(html_theme):
    # Lines of 99 columns fit.
    html_theme_options = {'light_css_variables': {'code-font-size': '12px'}}
# The anchors of headings that GitHub has.
myst_heading_anchors = 4

# Types, with shapes and units, are in the docstrings. What stands in `single quotes` there is a
# name of the reference.
default_role = 'py:obj'
autodoc_typehints = 'none'
autodoc_member_order = 'bysource'
napoleon_google_docstring = False
napoleon_use_param = napoleon_use_rtype = False
# Several attributes may share a line, as parameters do.
napoleon_custom_sections = [('Attributes', 'params_style')]


def write_pages(app):
    """Write the pages that are on the site only; see docs/generate.py."""
    spec = spec_from_file_location('generate', ROOT / 'docs' / 'generate.py')
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    module.write_site_pages(app.srcdir / 'generated')


def lead_outside(app, docname, source):
    """Let links, and files that are included, lead out of the folder of the pages."""
    if docname in WHOLE:
        text = (ROOT / WHOLE[docname]).read_text(encoding='utf-8')
        source[0] = BESIDE.sub('](../', text).replace('](docs/', '](')
    page = (ROOT / 'docs' / docname).parent

    def correct(match):
        target = Path(os.path.normpath(page / match['path']))
        if ROOT / 'docs' in target.parents:
            return match[0]
        if match['before'] == '](' and target.name in INCLUDED:
            target = ROOT / 'docs' / INCLUDED[target.name]
            return match['before'] + os.path.relpath(target, page)
        return match['before'] + os.path.relpath(target, (app.srcdir / docname).parent)

    source[0] = OUTSIDE.sub(correct, source[0])


def look_up(app, env, node, contnode):
    """Find a name of a docstring in the reference; what only exists is shown as it is."""
    name, domain = node['reftarget'], env.domains['py']
    if node['refdomain'] != 'py' or name.islower() and '.' not in name:
        return contnode  # a parameter, an attribute, or a type such as ndarray
    owner, _, attribute = name.rpartition('.')
    # The modules of the reference, whichever of them the docstring is in.
    for module in dict.fromkeys(known.rpartition('.')[0] for known, entry in domain.objects.items()
                                if entry.objtype in ('class', 'exception', 'function')):
        where = name
        if f'{module}.{name}' not in domain.objects and f'{module}.{owner}' in domain.objects \
                and re.search(rf'\b{attribute}\b', locate(f'{module}.{owner}').__doc__):
            where = owner  # an attribute that its class describes
        found = domain.resolve_xref(env, node['refdoc'], app.builder, 'obj', f'{module}.{where}',
                                    node, contnode)
        if found is not None:
            return found
    return contnode if locate(name) is not None else None


def setup(app):
    """Register what is done once, and with every page."""
    app.connect('builder-inited', write_pages)
    app.connect('source-read', lead_outside)
    app.connect('missing-reference', look_up)
