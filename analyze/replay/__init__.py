"""`analyze replay`: a recording as something to look at, in rerun, strike after strike as it is read.

    run.py              what is sent, in which order
    target.py           where to: a viewer, a browser, a file, a picture; viewer.py are rerun's own processes
    source.py, live.py  where from: a recording, whole or damaged, or one that is still being written
    *_scene.py, pictures.py, layout.py    what is sent and how it is laid out
    views.py, overlay.py, words.py        the same as plain arrays and text: no viewer there

Only this package imports rerun. What makes up the first strike's pictures loads nothing that computes: a user sees them within seconds.
"""
