"""The studio: a page in the browser where every change of a design is a change of everything.

``state`` reads and validates what is open on the page. The ``*_answers`` modules and
``file_exports`` compute the panels, with the library's public functions and nothing else;
``executors`` lists them and runs each in a thread or a process. ``server`` listens and holds what
all tabs share: the ``file_store`` and the ``searches``, whose run files come from ``run_request``.
``sessions`` guards its requests and has a session for each tab. The page is in ``page/``: plain
modules, no build step.

Public function (``import vinefab as vf``): ``vf.studio("mine.toml")``, see `vinefab.app.searching`.
"""

from vinefab.core.front_door import callable_room

callable_room(__name__)
