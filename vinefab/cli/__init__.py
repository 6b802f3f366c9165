"""One thin file per command; `main` names module and function of each and loads one of them."""
