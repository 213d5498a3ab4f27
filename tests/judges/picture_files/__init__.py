"""Picture files of public formats with the arrays that made them, and a judge of their readers.

The files are made by libraries that the reader doesn't use, or byte by byte from the formats'
specifications; no module here knows how labapp decodes.
"""

from judges.picture_files import array_kinds as array_kinds
from judges.picture_files import jpeg_kinds as jpeg_kinds
from judges.picture_files import mixtures as mixtures
from judges.picture_files import other_kinds as other_kinds
from judges.picture_files import png_kinds as png_kinds
from judges.picture_files import tiff_colour_kinds as tiff_colour_kinds
from judges.picture_files import tiff_kinds as tiff_kinds
from judges.picture_files import tiff_page_kinds as tiff_page_kinds
from judges.picture_files.runner import CRASHED as CRASHED
from judges.picture_files.runner import NAMED as NAMED
from judges.picture_files.runner import RIGHT as RIGHT
from judges.picture_files.runner import UNNAMED as UNNAMED
from judges.picture_files.runner import WRONG as WRONG
from judges.picture_files.runner import Finding as Finding
from judges.picture_files.runner import Read as Read
from judges.picture_files.runner import counts as counts
from judges.picture_files.runner import judge_kinds as judge_kinds
from judges.picture_files.runner import judge_reader as judge_reader
from judges.picture_files.runner import table as table
from judges.picture_files.truth import KINDS as KINDS
from judges.picture_files.truth import PictureFile as PictureFile
from judges.picture_files.truth import make_file as make_file
