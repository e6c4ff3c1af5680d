from ema.store.atomic import replacing as replacing
from ema.store.fields import load_fields as load_fields
from ema.store.reading import blocks as blocks
from ema.store.reading import describe as describe
from ema.store.reading import is_store as is_store
from ema.store.reading import load as load
from ema.store.writing import Writer as Writer
from ema.store.writing import save as save
