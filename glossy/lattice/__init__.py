"""The lattice method: few taps placed, sized and weighted for the lobe that a pixel sees.

``frame`` finds where the lobe lies in the plane of directions, ``table`` holds the taps for every
elongation of it, ``shade`` is the method and its defining pixel loop, ``tiles`` that loop laid out
for vector units.
"""
