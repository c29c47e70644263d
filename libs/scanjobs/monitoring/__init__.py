"""The mathematics of watching: tracks of modes, covariates, control charts, change points. Arrays in, values out."""
