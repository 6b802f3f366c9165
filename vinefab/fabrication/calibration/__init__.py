"""Calibration of a recipe: coupons and a table to fill in go out, a recipe file comes back.

Others use ``coupon_package`` (`make_coupons`, `coupon_files`), ``coupons`` (`joint_coupon`,
`results_text`, `read_results`) and ``fit_recipe`` (`calibrate`, `calibrated_recipe`).
"""
