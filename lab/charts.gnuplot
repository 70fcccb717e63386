# Draws rows of scree-lab --curves: gnuplot -e "rows='curves.csv'" lab/charts.gnuplot writes curves_*.svg to the current
# folder. One line per scene and view; dashed lines: clustered. float32 is drawn at 26 bits.
set datafile separator comma
set datafile columnheaders
set datafile missing NaN
set terminal svg size 800,420 background rgb 'white'
set key below noautotitle noenhanced
set grid
scenes = system("awk -F, 'NR > 1 && !seen[$5,$6,$7]++ { print $5 \"@\" $6 \"@\" $7 }' " . rows)
head(s) = s[:strstrt(s, '@') - 1]
tail(s) = s[strstrt(s, '@') + 1:]
name(s) = head(s) . (head(tail(s)) eq '1' ? '' : ' x' . head(tail(s))) . ', ' . tail(tail(s))
is(s, study, indices) = strcol('scene') eq head(s) && strcol('scale') eq head(tail(s)) && strcol('view') eq tail(tail(s)) \
  && strcol('study') eq study && (study ne 'samples' || strcol('positions') eq '16') \
  && (strcol('indices') eq indices || (indices eq 'packed' && strcol('indices') eq ''))
bits(text) = text eq 'float32' ? 26 : real(text)
wrong = "(100*column('wrong_pixels')/column('covered_pixels'))"
lines(study, x, y, indices, style) = sprintf("for [i=1:words(scenes)] rows using (is(word(scenes,i),'%s','%s') ? %s : NaN):(%s) \
  with linespoints lc i pt i ps 0.6 %s", study, indices, x, y, style)
draw(file, heading, study, x, xlabel, y, ylabel, log) = sprintf("unset logscale; %s; set output 'curves_%s.svg'; \
  set title '%s'; set xlabel '%s'; set ylabel '%s'; plot %s, %s", log, file, heading, xlabel, ylabel, \
  lines(study, x, y, 'packed', 'title name(word(scenes,i))'), lines(study, x, y, 'clustered', 'dt 2'))
log_y = 'set logscale y'
eval draw('wrong', 'Wrong pixels', 'positions', "bits(strcol('positions'))", 'bits per axis', wrong, '% of the covered', log_y)
eval draw('psnr', 'PSNR of the lit picture', 'positions', "bits(strcol('positions'))", 'bits per axis', "column('psnr_db')", 'dB', '')
eval draw('flip', 'FLIP', 'positions', "bits(strcol('positions'))", 'bits per axis', "column('flip_mean')", 'mean', log_y)
eval draw('error', 'Largest position error', 'positions', "bits(strcol('positions'))", 'bits per axis', "column('position_error')", 'model units', log_y)
eval draw('bytes', 'Size', 'positions', "bits(strcol('positions'))", 'bits per axis', "column('bytes_per_triangle')", 'bytes per triangle', '')
eval draw('speed', 'Time of a frame', 'positions', "bits(strcol('positions'))", 'bits per axis', "column('draw_ms')", 'ms', log_y)
eval draw('size_error', 'Error against size', 'positions', "column('bytes_per_triangle')", 'bytes per triangle', wrong, '% of the covered', log_y)
eval draw('snapping', 'Pixels that snapping alone makes wrong', 'snapping', "column('snap')", 'steps per pixel', wrong, '% of the covered', 'set logscale xy')
eval draw('depth', 'Depth error that codes alone make', 'depth', "column('depth_bits')", 'bits', "column('same_depth_error_rms')", 'relative, RMS', log_y)
eval draw('samples', 'Supersampling against 64 samples of the reference', 'samples', "column('samples_per_side')**2", 'samples per pixel', "column('psnr_db')", 'dB', '')
