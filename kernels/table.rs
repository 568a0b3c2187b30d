//! Lists the kernels in one table, from which plans and engines follow.

/// The table of kernels, in the order of a step. It calls the macro `$then` with all rows. All code that handles
/// kernels one by one follows from it. This is `Kernel` and `Step` in the runtime's plan, costs, checks, barriers,
/// hand-over, and the dispatch of both engines.
///
/// A row has the following entries. The value of `over` is the unit over which the CPU engine runs the kernel. The rate
/// of the `group` prices its work. With `binds` the row lists the buffers that the kernel reads, writes or updates, in
/// the order of the shader's bindings. The `args` are its arguments, if a step has one set of them. The expression
/// `fits` checks that the arguments match these buffers. The estimate `work` is in nanoseconds of one core. It is per
/// pupil pass (`u.pass`) for kernels that work on pupil passes, and per sub-frame for all others. The expression `twin`
/// is the call of the twin by the CPU engine. The expression `shader` runs the module of the kernel's name in the
/// Vulkan engine. The engine runs it `Once`, for `Each` pupil pass, or for each of its source's `Modes`.
#[macro_export]
macro_rules! kernels {
    ($then:ident) => {
        $then! {
            /// Zeroes the buffers to which the pupils add.
            Clear = "clear" {
                over: Whole, group: Field,
                binds: [Write Change, Write Hits],
                work: |u| 0.5 * u.points(),
                twin: |c| c.clear(),
                shader: Once |c| c.clear(),
            }
            /// Moves each phase to the nearest level, if the SLM has levels.
            Quantise = "quantise" {
                over: Frames, group: Levels,
                binds: [Read Phases, Read Levels, Write Shown],
                args: quantise: $crate::quantise::Args,
                fits: |step, shape| step.quantise.fits(shape.pixels()),
                work: |u| u.pixels() * f64::from(u.step.quantise.levels.max(2)).log2(),
                twin: |c| $crate::quantise::quantise(&c.step.quantise, c.phases, c.levels, c.shown),
                shader: Once |c| c.values(c.shape.pixels(), &c.step.quantise),
            }
            /// Computes the field from the phases, or from the levels shown for them.
            Modulate = "modulate" {
                over: Frames, group: Field,
                binds: [Read Shown, Write Field],
                work: |u| 2.0 * u.pixels(),
                twin: |c| {
                    let phases = if c.shape.quantised { &*c.shown } else { &*c.phases };
                    $crate::modulate::modulate(&c.shape.place, c.shape.field_scale(), phases, c.field);
                    (c.store)(c.field);
                },
                shader: Once |c| c.modulate(),
            }
            /// Computes the phases that the drives give, if the display model has more than phases.
            Drive = "drive" {
                over: Frames, group: Field,
                binds: [Read Shown, Read Pixels, Write Wave],
                args: drive: $crate::drive::Args,
                fits: |step, shape| step.drive.place == shape.place,
                work: |u| 0.3 * u.pixels(),
                twin: |c| c.drive(),
                shader: Once |c| c.drive(),
            }
            /// Applies the lag of the liquid crystal over the sub-frames.
            Lag = "lag" {
                over: Whole, group: Field,
                binds: [Update Wave],
                work: |u| 0.3 * u.pixels(),
                twin: |c| c.lag(false),
                shader: Once |c| c.lag(),
            }
            /// Applies crosstalk between pixels along rows, to each sub-pixel.
            CrosstalkRows = "crosstalk_rows" {
                over: Frames, group: Field,
                binds: [Read Crosstalk, Read Wave, Write Blurred],
                work: |u| u.crosstalk(),
                twin: |c| c.crosstalk(false),
                shader: Once |c| c.crosstalk([false, false]),
            }
            /// Applies crosstalk between pixels along columns.
            CrosstalkColumns = "crosstalk_columns" {
                over: Frames, group: Field,
                binds: [Read Crosstalk, Read Blurred, Write Wave],
                work: |u| u.subpixels() * u.crosstalk(),
                twin: |c| c.crosstalk(true),
                shader: Once |c| c.crosstalk([true, false]),
            }
            /// Computes the field of these phases, with the source's profile and the zero order.
            ModulateWave = "modulate_wave" {
                over: Frames, group: Field,
                binds: [Read Wave, Read Pixels, Write Field],
                work: |u| 2.2 * u.pixels(),
                twin: |c| c.modulate_wave(),
                shader: Once |c| c.modulate_wave(),
            }
            /// Computes the field on the pixels of a static mask, and behind the mask if it is at the SLM.
            ModulateMask = "modulate_mask" {
                over: Frames, group: Field,
                binds: [Read Wave, Read Pixels, Read Mask, Write Field],
                args: modulate_mask: $crate::modulate_mask::Args,
                fits: |step, shape| step.modulate_mask.fits(&shape.place),
                work: |u| 2.2 * u.pixels() + u.masked(),
                twin: |c| c.modulate_mask(),
                shader: Once |c| c.modulate_mask(),
            }
            /// Propagates the field from the SLM to a mask at a distance, and through it.
            ToMask = "to_mask" {
                over: Frames, group: Field,
                binds: [Update Field, Read Mask, Read MaskTransfer],
                work: |u| 2.0 * (u.full_transform() + u.points()),
                twin: |c| c.through_mask(false),
                shader: Once |c| c.through_mask(false),
            }
            /// Computes the field of each sub-pixel, if a pixel has several.
            ModulateSubpixels = "modulate_subpixels" {
                over: Frames, group: Field,
                binds: [Read Wave, Read Pixels, Write Subpixels],
                work: |u| 0.5 * u.subpixels() * u.subpixels() * u.pixels(),
                twin: |c| c.modulate_wave(),
                shader: Once |c| c.modulate_wave(),
            }
            /// Computes the central order of the sub-pixels' spectra, in the step's columns.
            SubpixelsForward = "subpixels_forward" {
                over: Frames, group: Field,
                binds: [Update Subpixels, Read Offsets, Write Field],
                work: |u| u.subpixels_transform(),
                twin: |c| c.subpixels_forward(),
                shader: Once |c| c.subpixels($crate::fft::Direction::Forward),
            }
            /// Computes the spectrum of the field, in the step's columns.
            FieldForward = "field_forward" {
                over: Frames, group: Field,
                binds: [Update Field],
                work: |u| u.grid_transform(),
                twin: |c| c.fft.run(c.field, $crate::fft::Direction::Forward),
                shader: Once |c| c.grid_transform($crate::fft::Direction::Forward),
            }
            /// Sums the light in each patch of the eyebox.
            Energy = "energy" {
                over: Whole, group: Field,
                binds: [Read Field, Write Energy],
                fits: |step, shape| step.equalise_eyebox.place.fits(&shape.place),
                work: |u| u.points(),
                twin: |c| $crate::energy::energy(&c.step.equalise_eyebox.place, c.field, c.energy),
                shader: Once |c| c.energy(),
            }
            /// Counts the pupils that pass each bin.
            Overlap = "overlap" {
                over: Whole, group: Window,
                binds: [Read Spans, Update Hits],
                work: |u| u.passing(),
                twin: |c| {
                    let modes = c.passes.iter().flat_map(|p| p.each_mode());
                    modes.for_each(|p| $crate::overlap::overlap(&p.overlap_args(), &p.spans, c.hits));
                },
                shader: Modes |c, p| c.rows(p.pass.rows, p.pass.columns, &p.overlap_args()),
            }
            /// Computes the propagation kernel of each pupil's window.
            Transfer = "transfer" {
                over: PupilPasses, group: Window,
                binds: [Read Spans, Write Transfer],
                work: |u| 4.0 * u.passing(),
                twin: |c| c.each_mode(|_, p, transfer| $crate::transfer::transfer(&p.transfer, &p.spans, transfer)),
                shader: Once |c| c.transfer(),
            }
            /// Applies the response of the pixel aperture and the relay to each bin.
            Relay = "relay" {
                over: PupilPasses, group: Window,
                binds: [Read Relay, Read Spans, Update Transfer],
                work: |u| 2.0 * u.passing(),
                twin: |c| {
                    let (points, relay) = (c.shape.points(), c.relay);
                    c.each_mode(|_, p, transfer| {
                        let own = &relay[p.source_mode * points..][..points];
                        $crate::relay::relay(&p.pass, own, &p.spans, transfer);
                    });
                },
                shader: Modes |c, p| c.rows(p.pass.rows, p.pass.columns, &p.pass),
            }
            /// Applies the aberration of the viewer's eye to each bin, if the eye is not perfect.
            Eye = "eye" {
                over: PupilPasses, group: Window,
                binds: [Read EyeTerms, Read Spans, Update Transfer],
                work: |u| 4.0 * u.passing(),
                twin: |c| c.each_mode(|_, p, transfer| if let (Some(terms), Some(args)) = (&p.eye, p.eye_args()) {
                    $crate::eye::eye(&args, terms, &p.spans, transfer);
                }),
                shader: Modes |c, p| match p.eye_args() {
                    Some(args) => c.rows(args.rows, args.columns, &args),
                    None => Ok(()),
                },
            }
            /// Weakens the propagation kernel towards the edges, in pupil passes with a taper.
            Taper = "taper" {
                over: PupilPasses, group: Window,
                binds: [Read TaperWeights, Update Transfer],
                work: |u| 4.0 * u.passing(),
                twin: |c| c.each_mode(|_, p, transfer| if let Some(weights) = &p.taper {
                    $crate::taper::taper(weights, p.window.columns, transfer);
                }),
                shader: Each |c, p| c.rows(p.transfer.rows, p.transfer.columns, &[p.transfer.rows, p.transfer.columns]),
            }
            /// Sums the target image of the light field, on a level of its pyramid.
            Photograph = "photograph" {
                over: PupilPasses, group: Photograph,
                binds: [Read Views, Read Taps, Write Accumulator],
                work: |u| u.taps(),
                twin: |c| c.photograph(),
                shader: Once |c| c.photograph(),
            }
            /// Resamples the target image to the size of the window.
            Resample = "resample" {
                over: PupilPasses, group: Photograph,
                binds: [Read Accumulator, Read RowWeights, Read ColumnWeights, Write Target],
                work: |u| u.level() + u.window(),
                twin: |c| c.resample(),
                shader: Once |c| c.resample(),
            }
            /// Cuts each pupil's window out of the spectrum and propagates it.
            PassPupil = "pass_pupil" {
                over: Windows, group: Window,
                binds: [Read Field, Read Transfer, Read Spans, Write Window],
                work: |u| u.frames() * u.passing(),
                twin: |c| {
                    $crate::pass_pupil::pass_pupil(&c.pass.pass, c.field, c.transfer, &c.pass.spans, c.window);
                    (c.store)(c.window);
                },
                shader: Modes |c, p| c.rows(p.pass.rows, p.pass.columns, &p.pass),
            }
            /// Shifts each sub-frame for the motion of the eye, if it moves.
            Motion = "motion" {
                over: Windows, group: Window,
                binds: [Read Moments, Update Window],
                work: |u| u.moving(),
                twin: |c| c.motion(false),
                shader: Modes |c, p| c.motion(p, false),
            }
            /// Transforms the spectra of the windows to retinal fields, in the pupil pass's columns.
            WindowInverse = "window_inverse" {
                over: Windows, group: Window,
                binds: [Update Window],
                work: |u| u.frames() * u.window_transform(),
                twin: |c| c.fft($crate::fft::Direction::Inverse),
                shader: Modes |c, p| c.window_transform(p, $crate::fft::Direction::Inverse),
            }
            /// Sums the intensity that an eye averages over the sub-frames.
            Intensity = "intensity" {
                over: PupilPasses, group: Window,
                binds: [Read Window, Write Image],
                work: |u| u.fields() * 0.5,
                twin: |c| c.intensity(),
                shader: Modes |c, p| c.intensity(p),
            }
            /// Compares image and target, replaces the image by the factor on each field sample, and sums the loss.
            Compare = "compare" {
                over: PupilPasses, group: Window,
                binds: [Update Image, Read Target, Write Losses],
                work: |u| u.window() * 2.0,
                twin: |c| {
                    c.slot.loss = $crate::compare::compare(&c.pass.compare, &mut c.slot.image, &c.slot.target);
                },
                shader: Each |c, p| c.parts(p.compare.parts(), &p.compare),
            }
            /// Multiplies the retinal fields by that factor.
            ApplyFactor = "apply_factor" {
                over: Windows, group: Window,
                binds: [Read Image, Update Window],
                work: |u| u.fields() * 0.5,
                twin: |c| {
                    $crate::apply_factor::apply_factor(c.image, c.window);
                    (c.store)(c.window);
                },
                shader: Modes |c, p| c.values(p.count(), &(p.count() as u32)),
            }
            /// Transforms the retinal fields to spectra, in the pupil pass's columns.
            WindowForward = "window_forward" {
                over: Windows, group: Window,
                binds: [Update Window],
                work: |u| u.frames() * u.window_transform(),
                twin: |c| c.fft($crate::fft::Direction::Forward),
                shader: Modes |c, p| c.window_transform(p, $crate::fft::Direction::Forward),
            }
            /// Applies the adjoint of `motion`.
            MotionBack = "motion_back" {
                over: Windows, group: Window,
                binds: [Read Moments, Update Window],
                work: |u| u.moving(),
                twin: |c| c.motion(true),
                shader: Modes |c, p| c.motion(p, true),
            }
            /// Adds the requests of the dispatch's pupils to the change, in their order.
            PupilAdjoint = "pupil_adjoint" {
                over: Frames, group: Window,
                binds: [Read Window, Read Transfer, Read Spans, Update Change],
                work: |u| u.frames() * u.passing(),
                twin: |c| c.pupil_adjoints(),
                shader: Modes |c, p| c.rows(p.back.rows, p.back.columns, &p.back),
            }
            /// Divides the change by a power of the overlap.
            DivideByOverlap = "divide_by_overlap" {
                over: Frames, group: Update,
                binds: [Read Hits, Update Change],
                args: divide_by_overlap: $crate::divide_by_overlap::Args,
                fits: |step, shape| {
                    let (args, place) = (&step.divide_by_overlap, &shape.place);
                    (args.grid_height, args.grid_width) == (place.grid_height, place.grid_width)
                },
                work: |u| u.points(),
                twin: |c| {
                    $crate::divide_by_overlap::divide_by_overlap(&c.step.divide_by_overlap, c.hits, c.change);
                    (c.store)(c.change);
                },
                shader: Once |c| c.values(c.shape.points(), &c.step.divide_by_overlap),
            }
            /// Adds a change that brings the patches of the eyebox nearer to their mean.
            EqualiseEyebox = "equalise_eyebox" {
                over: Frames, group: Update,
                binds: [Read Energy, Read Field, Update Change],
                args: equalise_eyebox: $crate::equalise_eyebox::Args,
                fits: |step, shape| step.equalise_eyebox.place.fits(&shape.place),
                work: |u| u.points(),
                twin: |c| {
                    $crate::equalise_eyebox::equalise_eyebox(&c.step.equalise_eyebox, c.energy, c.field, c.change);
                    (c.store)(c.change);
                },
                shader: Once |c| {
                    let args = &c.step.equalise_eyebox;
                    c.rows(args.place.rows, args.place.columns, args)
                },
            }
            /// Transforms the change of the spectrum to the change of the field, in the step's columns.
            ChangeInverse = "change_inverse" {
                over: Frames, group: Update,
                binds: [Update Change],
                work: |u| u.grid_transform(),
                twin: |c| c.fft.run(c.change, $crate::fft::Direction::Inverse),
                shader: Once |c| c.grid_transform($crate::fft::Direction::Inverse),
            }
            /// Sets all losses to NaN if a value of the change is infinite or NaN, so that the step is not taken. It
            /// runs if fields are stored as halves.
            CheckFinite = "check_finite" {
                over: Whole, group: Update,
                binds: [Read Change, Write NotFinite],
                fits: |_, shape| shape.halves(),
                work: |u| 0.5 * u.points(),
                twin: |c| c.check_finite(),
                shader: Once |c| c.check_finite(),
            }
            /// Transforms the change of the spectrum to the change of each sub-pixel's field, if a pixel has several.
            SubpixelsInverse = "subpixels_inverse" {
                over: Frames, group: Update,
                binds: [Update Subpixels, Read Offsets, Read Change],
                work: |u| u.subpixels_transform(),
                twin: |c| c.subpixels_inverse(),
                shader: Once |c| c.subpixels($crate::fft::Direction::Inverse),
            }
            /// Computes the gradient of the field's phases from the change.
            PhaseGradient = "phase_gradient" {
                over: Frames, group: Update,
                binds: [Read Pixels, Read Change, Update Wave],
                work: |u| 0.5 * u.pixels(),
                twin: |c| c.phase_gradient(),
                shader: Once |c| c.phase_gradient(),
            }
            /// Propagates the change behind a mask at a distance back to the SLM.
            FromMask = "from_mask" {
                over: Frames, group: Update,
                binds: [Update Change, Read Mask, Read MaskTransfer],
                work: |u| 2.0 * (u.full_transform() + u.points()),
                twin: |c| c.through_mask(true),
                shader: Once |c| c.through_mask(true),
            }
            /// Computes the gradient of the field's phases from the change on the pixels of a mask.
            PhaseGradientMask = "phase_gradient_mask" {
                over: Frames, group: Update,
                binds: [Read Pixels, Read Mask, Read Change, Update Wave],
                fits: |step, shape| step.modulate_mask.fits(&shape.place),
                work: |u| 0.5 * u.pixels() + u.masked(),
                twin: |c| c.phase_gradient_mask(),
                shader: Once |c| c.phase_gradient_mask(),
            }
            /// Computes the gradient of each sub-pixel's phases from the change.
            PhaseGradientSubpixels = "phase_gradient_subpixels" {
                over: Frames, group: Update,
                binds: [Read Pixels, Read Subpixels, Update Wave],
                work: |u| 0.5 * u.subpixels() * u.subpixels() * u.pixels(),
                twin: |c| c.phase_gradient(),
                shader: Once |c| c.phase_gradient(),
            }
            /// Applies the transpose of the crosstalk along columns.
            CrosstalkColumnsBack = "crosstalk_columns_back" {
                over: Frames, group: Update,
                binds: [Read Crosstalk, Read Wave, Write Blurred],
                work: |u| u.subpixels() * u.crosstalk(),
                twin: |c| c.crosstalk_back(true),
                shader: Once |c| c.crosstalk([true, true]),
            }
            /// Applies the transpose of the crosstalk along rows.
            CrosstalkRowsBack = "crosstalk_rows_back" {
                over: Frames, group: Update,
                binds: [Read Crosstalk, Read Blurred, Write Wave],
                work: |u| u.crosstalk(),
                twin: |c| c.crosstalk_back(false),
                shader: Once |c| c.crosstalk([false, true]),
            }
            /// Applies the transpose of the lag.
            LagAdjoint = "lag_adjoint" {
                over: Whole, group: Update,
                binds: [Update Wave],
                work: |u| 0.3 * u.pixels(),
                twin: |c| c.lag(true),
                shader: Once |c| c.lag(),
            }
            /// Carries the gradient back to the phases, as the change of a field that has only these phases.
            DriveAdjoint = "drive_adjoint" {
                over: Frames, group: Update,
                binds: [Read Pixels, Read Shown, Read Wave, Update Change],
                work: |u| 0.6 * u.pixels(),
                twin: |c| c.drive_adjoint(),
                shader: Once |c| c.drive_adjoint(),
            }
            /// Moves the phases by the step of the projection.
            Project = "project" {
                over: Frames, group: Update,
                binds: [Read Change, Read Shown, Update Phases, Update Momentum],
                args: project: $crate::project::Args,
                fits: |step, shape| step.project.place == shape.place,
                work: |u| 4.0 * u.pixels(),
                twin: |c| {
                    let shown = c.shape.quantised.then_some(&*c.shown);
                    match c.shape.binary_angles {
                        true => $crate::project::project_angles(&c.step.project, c.change, c.phases, c.momentum),
                        false => $crate::project::project(&c.step.project, c.change, shown, c.phases, c.momentum),
                    }
                },
                shader: Once |c| c.rows(c.shape.place.height, c.shape.place.width, &c.step.project),
            }
            /// Moves the phases by a step of Adam.
            Adam = "adam" {
                over: Frames, group: Update,
                binds: [Read Change, Read Shown, Update Phases, Update Momentum, Update Second],
                args: adam: $crate::adam::Args,
                fits: |step, shape| step.adam.place == shape.place,
                work: |u| 4.0 * u.pixels(),
                twin: |c| {
                    let shown = c.shape.quantised.then_some(&*c.shown);
                    $crate::adam::adam(&c.step.adam, c.change, shown, c.phases, c.momentum, c.second);
                },
                shader: Once |c| c.rows(c.shape.place.height, c.shape.place.width, &c.step.adam),
            }
            /// Computes the sums that give the fitted exposure and the PSNR.
            Exposure = "exposure" {
                over: PupilPasses, group: Window,
                binds: [Read Image, Read Target, Write Sums],
                work: |u| u.window() * 2.0,
                twin: |c| {
                    let args = c.pass.exposure(&c.shape.on_grid());
                    $crate::exposure::exposure(&args, &c.slot.image, &c.slot.target, &mut c.slot.sums);
                },
                shader: Each |c, p| {
                    let args = p.exposure(&c.shape.on_grid());
                    c.parts(args.parts(), &args)
                },
            }
        }
    };
}
