"""From a design to a checked fabrication package; never loads the simulator.

`job` lays out the paths of the laser, `rules` check them and the outline, `formats` write and
read machine files, `package` collects everything to fabricate, `calibration` makes coupons and
recipes. Other rooms start from `checking.check_design`, `profile_listing` and `package`.
"""
