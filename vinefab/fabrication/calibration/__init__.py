"""Calibration of a recipe: coupons and a table to fill in go out, a recipe file comes back.

Others use ``coupon_package`` (`make_coupons`, `coupon_files`), ``coupon_results``
(`results_text`, `read_results`), ``fit_recipe`` (`calibrate`) and ``calibrated_recipe``.
"""
