// Written by `cargo run -p eyebox-spirv-tool -- build`: change nothing here.
modules! {
    ADAM = "adam", ADAM_HALF = "adam_half";
    APPLY_FACTOR = "apply_factor", APPLY_FACTOR_HALF = "apply_factor_half";
    CHECK_FINITE = "check_finite";
    COMPARE = "compare";
    COMPARE_ROWS = "compare_rows", COMPARE_ROWS_HALF = "compare_rows_half";
    DIVIDE_BY_OVERLAP = "divide_by_overlap", DIVIDE_BY_OVERLAP_HALF = "divide_by_overlap_half";
    ENCODE = "encode";
    ENERGY = "energy", ENERGY_HALF = "energy_half";
    EQUALISE_EYEBOX = "equalise_eyebox", EQUALISE_EYEBOX_HALF = "equalise_eyebox_half";
    EXPOSURE = "exposure";
    FFT_CHIRP = "fft_chirp", FFT_CHIRP_HALF = "fft_chirp_half";
    FFT_PASS = "fft_pass", FFT_PASS_HALF = "fft_pass_half";
    FFT_SHARED = "fft_shared", FFT_SHARED_HALF = "fft_shared_half";
    GATHER_COLUMNS = "gather_columns", GATHER_COLUMNS_HALF = "gather_columns_half";
    INTENSITY = "intensity", INTENSITY_HALF = "intensity_half";
    JUDGE = "judge";
    MODULATE = "modulate", MODULATE_HALF = "modulate_half";
    MODULATE_ROWS = "modulate_rows", MODULATE_ROWS_HALF = "modulate_rows_half";
    OVERLAP = "overlap";
    PASS_COLUMNS = "pass_columns", PASS_COLUMNS_HALF = "pass_columns_half";
    PASS_PUPIL = "pass_pupil", PASS_PUPIL_HALF = "pass_pupil_half";
    PHOTOGRAPH = "photograph";
    PIXELS = "pixels";
    PROJECT = "project", PROJECT_HALF = "project_half";
    PROJECT_ROWS = "project_rows", PROJECT_ROWS_HALF = "project_rows_half";
    QUANTISE = "quantise";
    RESAMPLE = "resample";
    RETURN_PUPIL = "return_pupil", RETURN_PUPIL_HALF = "return_pupil_half";
    TAPER = "taper";
    TRANSFER = "transfer";
    WINDOW_COLUMNS = "window_columns", WINDOW_COLUMNS_HALF = "window_columns_half";
}
