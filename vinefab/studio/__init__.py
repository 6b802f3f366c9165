"""The studio: a page in the browser where every change of a design is a change of everything.

``state`` reads what is open on the page; each ``*_answer`` module turns it into what one panel
shows, with the library's public functions and nothing else. ``panels`` lists them and where each is
computed, ``lanes`` are the processes, ``app`` is the server, ``gate`` its guard, ``desk`` the files
that the user opened, ``search_desk`` the searches that the page begins with what ``run_request``
writes. The page is in ``page/``: plain modules, no build step.

Public function (``import vinefab as vf``): ``vf.studio("mine.toml")``, see `vinefab.app.searching`.
"""

from vinefab.core.front_door import callable_room

callable_room(__name__, "app.searching")
