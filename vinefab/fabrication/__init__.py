"""From a design to a checked fabrication package; never loads the simulator.

`outline` draws the body, `job` lays out the laser's paths, `rules` check both, `formats` write and
read machine files, `package` collects everything to fabricate, `calibration` makes coupons and
recipes. Other rooms start from `checking.check_design`, `profile_listing` and `package`.
"""
