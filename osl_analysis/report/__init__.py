"""The report of a run: one page that shows every trial behind the figures, from result tables and
thinned signals.

`trial_page`, `trial_table` and `condition_rows` select what is shown, `page` writes it. The page
draws a trial when the reader asks for it (`templates/report.js`), with the JavaScript of
Bokeh."""

from pathlib import Path

# the folder with the page's template, style and script
TEMPLATES = Path(__file__).with_name("templates")
# Bokeh's own JavaScript: its package would bring three others, and 35 MB of which the page uses
# nothing
BOKEH = Path(__file__).with_name("bokeh")
