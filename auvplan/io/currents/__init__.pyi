from .files import open_members as open_members
from .ocean import OceanData as OceanData
from .ocean import open_ocean as open_ocean
from .ocean import to_cf as to_cf
from .reader import CurrentFile as CurrentFile
from .reader import read_current as read_current

__all__ = ["CurrentFile", "OceanData", "open_members", "open_ocean", "read_current", "to_cf"]
