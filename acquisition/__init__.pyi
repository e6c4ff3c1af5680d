from acquisition.contents import Contents as Contents
from acquisition.folder import open_campaign as open_campaign
from acquisition.model_file import open_model as open_model
from acquisition.registry import formats as formats
from acquisition.registry import read as read
from acquisition.registry import write as write
from acquisition.taking import open_rig as open_rig
from acquisition.taking import record as record
