"""Replay of a recording in the viewer rerun (`analyze replay`), strike by strike as it is read.

::

    run.py                              order in which the parts of a recording are sent
    target.py                           destinations: a viewer, a browser, a file, a picture
    viewer.py                           rerun's own processes
    source.py, live.py                  sources: a recording, whole or damaged, or still being written
    *_scene.py, pictures.py, layout.py  contents and layout of the pages
    views.py, overlay.py, words.py      their data as plain arrays and text, independent of a viewer
    animation.py, animat*_*.py          moving picture of one strike, drawn by tip_drawing.py without rerun
    cards.py                            placement cards of a strike plan, as a file for rerun's viewer

Only this package imports rerun. The images of the first strike are sent before any numerical module is
imported, so that they appear within seconds.
"""
